"""Many takes: find them, plan where results go, repair each in a process that may die, and journal every result.

    inputs.find -> plan -> RepairJob -> pool.run or cluster.run -> FinishedTake | WorkerError -> Journal -> report

``repairing`` is the only module here that repairs takes; ``pool`` and ``cluster`` run any ``Work``.
"""
