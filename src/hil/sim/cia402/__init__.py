"""A CiA 402 servo drive that is not there: objects, state machine, motion and homing, as a bus sees it."""
