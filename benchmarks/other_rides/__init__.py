"""Sealed cases of bicycle rides from a world of its own, written without sight of the diagnosis.

The world shares no equation with `hil`: one chain of poses that is differentiated by numbers, the steer
that keeps the whole bicycle in balance (moments of all bodies about the line of contacts), tyres and
fork as a plane model on an uneven floor, sensors as they are bought, fourteen faults from outside the
catalogue.

    python -m benchmarks.other_rides OUT --seed 1 --count 60
    python -m benchmarks.other_rides.check      # a perfect bicycle against `hil`'s model
"""
