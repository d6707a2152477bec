"""Drives one by one at the desk: scanned, read, written, homed, jogged."""
