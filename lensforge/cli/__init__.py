"""What does a user type, and what is printed? Commands, their options, and the screen.

- ``cli.main``: the program
- ``options``: options and their help
- ``stages``: a command for each stage of verbs.py
- ``design``: design, preview, sweep and tradeoff
- ``specs``: new, examples and schema
- ``rays``: summary and conversion of ray files
- ``output``: the screen, and JSON
- ``progress``: the line and clock of a stage
- ``interrupts``: Ctrl-C and signals
- ``conclusion``: results and verdict at the end of a command
"""
