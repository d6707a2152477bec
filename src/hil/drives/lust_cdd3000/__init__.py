"""The CANLust protocol of LUST CDD3000 servo controllers: `codec`, `driver`, `bus`, `dbc`.

Facts, defaults and their sources stand in drives/lust_cdd3000/drive.toml. Import the module you need: the
package hands out no names, because the gate's reading of frames wants the codec and nothing of the driver.
"""
