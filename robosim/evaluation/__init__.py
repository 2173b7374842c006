"""Evaluation of goal policies on the same tasks.

- `suite`: tasks, drawn from floor plans or read from a file;
- `episodes`: episodes on any number of workers, one file each; a run that was stopped resumes;
- `search_scores`: difficulty, arrival rates, relative arrival times, with their intervals;
- `task_picture`, `report`: pictures of tasks and a page of them;
- `evaluate`: all of it, behind `robosim evaluate`.
"""
