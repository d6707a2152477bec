"""The runs as one flat problem: samples, what the twin predicts, when setpoints act, what repeats."""
