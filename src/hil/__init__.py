"""hil runs motion-simulator rigs with servo drives on CAN and explains where the model differs from the rig."""

__version__ = "0.1.0"
