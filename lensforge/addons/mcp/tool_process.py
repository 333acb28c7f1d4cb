"""First code of the process of a tool: it ends with the server, however that ends, and runs a module.

``python -m … SERVER MODULE ARGUMENTS``, with the number of the process of the server.
"""

import runpy
import sys

from lensforge.results.worker import end_with_parent

if __name__ == "__main__":
    server, module, *arguments = sys.argv[1:]
    end_with_parent(int(server))
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)
