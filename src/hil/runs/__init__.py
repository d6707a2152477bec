"""Recordings: what a run leaves behind, written while it runs, read back and checked."""
