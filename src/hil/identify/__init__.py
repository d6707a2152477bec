"""What a rig's parameters are, and how well they are known.

`hil.identify.experiments` designs and plays motions, `hil.identify.estimate` fits parameters to what
was recorded, describing functions say how the rig answers by frequency.
"""
