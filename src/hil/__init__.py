"""hil runs motion-simulator rigs with servo drives on CAN and explains where model and rig differ."""

__version__ = "0.1.0"
