"""Broken and invented files and messages for every reader: read, or refused in one line, and nothing else."""
