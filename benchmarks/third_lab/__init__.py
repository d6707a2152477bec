"""A third laboratory: a world of its own that makes sealed diagnosis cases.

Written without sight of the diagnosis, of the twin or of the other worlds: only the gap's contract, the
equations of the rigs and the rig files are shared. A free body on six elastic members (legs, guides), motors
behind elastic transmissions, Maxwell-slip or LuGre friction, ticks and slots with jitter, fifteen faults from
outside the catalogue.

    python -m benchmarks.third_lab OUT --rig axis --seed 1 --count 40     # also motorcycle, stewart
    python -m benchmarks.third_lab.check axis motorcycle stewart          # against rigid inverse dynamics
"""
