"""Candidates fitted through the twin, and what they leave of seen and unseen data."""
