"""One confined runner for all work on what strangers send: models, settings, road files, records.

`runner.run` runs a task of `tasks.TASKS` in a new process and returns its answer; `process.ConfinedProcess` is the same
for a task that answers step by step. A process serves one task and ends. Nothing is re-exported here: the confined
process imports this package and must stay small.
"""
