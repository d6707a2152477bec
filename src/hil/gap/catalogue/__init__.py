"""What might be the matter: effects at their places, what each does, and what a calibration sets right."""
