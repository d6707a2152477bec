"""Rounds of a diagnosis: all candidates beside one twin, and the other twins that a healthy rig may be."""
