"""CiA 402 drives over CANopen: `codec`, `sdo`, `configure`, `driver`, `bus`, `meaning`.

Facts and defaults stand in drives/cia402/drive.toml and its EDS. Import the module you need: the package
hands out no names, because the gate's reading of frames wants the codec and nothing of the driver.
"""
