"""What is typed: the commands, their options, and the screen that they print."""
