"""A bicycle that is ridden and recorded: its rides, measured or simulated, and what is computed of them.

`analyse` takes a run apart, `simulate_ride` makes one without a bicycle, `calibrate` sets sensors right.
"""
