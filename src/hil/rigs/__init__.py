"""What moves: kinematics and dynamics of the rigs, compiled, with an object to hold one rig."""
