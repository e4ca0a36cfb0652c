"""The commands, each in the file of its name: a parser, and what it calls."""
