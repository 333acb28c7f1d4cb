"""The commands, one module for each kind of work; what a command needs is imported when it runs."""
