"""Evaluation of goal policies: the same tasks for all of them, many at once, and what came of it.

- `suite`: which searches are made, drawn from floor plans or read from a file;
- `episodes`: one episode in a process of its own, and the file it leaves;
- `sweep`: all of them on any number of workers, going on where a run was stopped;
- `scores`: difficulty, arrival rates, relative arrival times, with their intervals;
- `charts`, `report`: pictures and a page of them;
- `evaluate`: the whole, behind `robosim evaluate`.
"""
