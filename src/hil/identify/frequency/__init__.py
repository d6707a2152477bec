"""Describing functions: frequency responses with uncertainty, nonlinear distortion, delay, AGARD measures.

`analyse` turns runs into a response with everything that is known about it.
"""
