"""Which candidates are worth a fit: the linear picture, replays of what no column shows, sets, rivals."""
