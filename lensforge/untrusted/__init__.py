"""Files that come from outside: bounds before they are parsed, and child processes with limits to parse them in."""
