"""The noise floor: what a residual would be with no gap at all, and how to weigh residuals by it."""
