"""Many takes: find them, plan what is written where, work at them in processes that may die, and keep what was found.

    find -> Input -> plan -> Job -> run -> Done | WorkerError -> journal -> report

Nothing here knows what is done with a take but ``repairing``; ``run`` and ``cluster`` take any ``Work``.
"""
