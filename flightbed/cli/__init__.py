"""The command line, one command per file. The only package that imports cyclopts."""
