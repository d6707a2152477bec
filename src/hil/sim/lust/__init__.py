"""A LUST CDD3000 that is not there: parameters, power stage, slots, as its bus sees them."""
