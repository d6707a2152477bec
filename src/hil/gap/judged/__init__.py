"""What the fits amount to: which are findings, whether it is none of the catalogue, causes, the verdict."""
