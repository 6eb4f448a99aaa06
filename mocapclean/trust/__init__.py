"""Rules that lower trust. A rule never raises it.

A rule module has ``Params`` (its parameters) and ``examine(take, params)``, which returns the samples it distrusts as
an (F, M) bool mask and its Findings. ``detect`` runs rules one after the other, each on what the one before trusts.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import ModuleType
from typing import Any

from mocapclean.errors import UsageError
from mocapclean.records import Take
from mocapclean.trust import missing, tdd

RULES: dict[str, ModuleType] = {"missing": missing, "tdd": tdd}


def detect(take: Take, rules: Mapping[str, Any] | None = None) -> Take:
    """Run trust rules over a take and return it with less trust and more findings.

    rules: rule name -> its ``Params``, in the order in which they run; None runs all of ``RULES`` with their
    defaults. Raises UsageError for a name that is not in ``RULES``.
    """
    chosen = {name: module.Params() for name, module in RULES.items()} if rules is None else rules
    for name, params in chosen.items():
        if name not in RULES:
            raise UsageError(f"a trust rule must be one of {', '.join(RULES)}. Got {name!r}.")
        distrusted, findings = RULES[name].examine(take, params)
        take = replace(take, trusted=take.trusted & ~distrusted, findings=(*take.findings, *findings))
    return take
