"""Benchmarks against peers: `python -m tests.benchmarks` from the repository root measures all in one run.

Contestants (`peers/`, `ours.py`) answer one protocol (`peers/base.py`); scenes and views are in `scenes.py`.
"""
