"""The measured figures of the project: each module measures one thing, with the code as it ships.

`python -m benchmarks [NAME ...]` prints their tables; docs/figures.md keeps what came out and where.
"""
