"""Another lab's rigs: an independent simulation world that makes sealed diagnosis cases.

    python -m benchmarks.other_lab OUT --rig axis --seed 1 --count 40      # also motorcycle, stewart
    hil gap exam sit OUT --out DIAGNOSES
    hil gap exam mark DIAGNOSES --answers OUT/answers

Written by somebody who had seen neither the diagnosis nor the exam's world, so that what is tuned on the
one can be held against the other. From `hil` comes the reader of rig files and nothing else: dynamics by
Jacobians of points (`mechanism`), friction by LuGre, Maxwell-slip or tanh laws (`friction`), drives,
transmissions and floor (`plant`), a healthy rig's small differences (`world`), motions, records with
jitter and noise, effects of the catalogue (`effects`, drawn by `recipes`) and twelve faults that it
has no name for (`outside`).

Of ten cases three are healthy, four have one effect, one has two, two a fault from outside; effects and
faults come from shuffled decks. Severity (`severity`) is aimed at 1, 3 or 10 within what a rig could
have. Effects that a calibration on the same runs would absorb come with a healthy reference run.
`answers/<id>/notes.json` tells the examiner severity, floors, motions and the names of faults.
"""
