"""The help of ``lensforge`` itself: its commands by what they are for, units, presets, exit codes and completion."""

import click

SECTIONS = {
    "Design": ("new", "preview", "design", "sweep", "tradeoff", "examples", "schema"),
    "One stage of a result folder again": ("evaluate", "export", "check", "verify", "photometry", "report"),
    "Tolerances": ("sensitivity", "yield"),
    "The shop and the machined part": ("handover", "compare", "correct"),
}
_REST = "Files"
NOTES = """\b
Units:    lengths in mm, angles in degrees, wavelengths in nm, flux lm or W.
Numbers:  whole numbers may be written as 1e6.
Presets:  --accuracy draft, standard (default) or reference: more rays, finer
          tables and more functions of the surfaces; each takes longer.
Output:   stdout has one screen; --json all digits, --quiet nothing.
          Progress, warnings and errors go to stderr.
Exit:     0 done; 1 light or files failed (cutting, where the spec requires
          it); 2 bad input. lensforge COMMAND --help has the options.
Shell:    completion by eval "$(_LENSFORGE_COMPLETE=bash_source lensforge)"
          in ~/.bashrc; zsh_source for zsh, fish_source for fish."""


class CommandGroup(click.Group):
    """The group of all commands, which is called without one, too."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands under their headings, those of no heading last."""
        named = {name for names in SECTIONS.values() for name in names}
        rest = tuple(name for name in self.list_commands(ctx) if name not in named)
        for title, names in {**SECTIONS, _REST: rest}.items():
            found = [(name, self.get_command(ctx, name)) for name in names]
            limit = formatter.width - 20
            rows = [(name, command.get_short_help_str(limit)) for name, command in found if command is not None]
            if rows:
                with formatter.section(title):
                    formatter.write_dl([(name.ljust(11), words) for name, words in rows])
