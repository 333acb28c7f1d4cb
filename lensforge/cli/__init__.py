"""Commands, their options, and the screen that they print."""
