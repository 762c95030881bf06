"""The command line: arguments, exit codes, text on the terminal. The only package that imports cyclopts; it computes no results."""
