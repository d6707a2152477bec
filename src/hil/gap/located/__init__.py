"""Where the twin differs from the rig: data sanity, nuisances refitted, energy by signal, band and region."""
