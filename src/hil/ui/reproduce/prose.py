"""The words of a section, kept apart from what computes its numbers; HTML with {names} to fill in."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Prose:
    """`paper`: what the paper shows, in our words. `ours`: what was done here. `reading`: what it says."""

    title: str
    paper: str
    ours: str
    reading: str

    def filled(self, **values: object) -> Prose:
        """With `values` by name in all texts; KeyError for a name that is not given."""
        return Prose(
            self.title,
            self.paper.format(**values),
            self.ours.format(**values),
            self.reading.format(**values),
        )


R = '<span class="mark">[R]</span>'
M = '<span class="mark">[M]</span>'
F = '<span class="mark">[F]</span>'
"""Marks of a number's standing: reconstructed, general knowledge, found in a public source."""
