"""Files of CAD programs from outside, read by the CAD kernel in a child process."""
