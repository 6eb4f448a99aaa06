"""The parameters of training a dictionary, which the help of ``mocapclean train`` needs by themselves.

Z. Wang, Y. Feng, S. Liu, J. Xiao, X. Yang, J. J. Zhang, 2016, prints L, K and λ alone; the other numbers are of
benchmarks/llc_sweep.csv.
"""

from typing import Annotated

from mocapclean.parameters import About, Field, parameters


@parameters
class Params:
    """How much is learnt and from how much."""

    window: Annotated[int, Field(ge=1), About(symbol="L", unit="frames", text="length of an atom")] = 30
    atoms: Annotated[
        int, Field(ge=1), About(symbol="K", text="most atoms of a part; one for 4 training windows at most")
    ] = 1024
    sparsity: Annotated[int, Field(ge=1), About(symbol="t", text="atoms that code a window in training")] = 4
    sweeps: Annotated[int, Field(ge=1), About(symbol="n", text="passes of K-SVD")] = 8
    windows: Annotated[int, Field(ge=1), About(symbol="N", text="most training windows of a part, drawn at random")] = (
        8192
    )
    hole_passes: Annotated[int, Field(ge=0), About(symbol="p", text="missing-aware passes after K-SVD")] = 2
    hole_share: Annotated[
        float, Field(ge=0, lt=1), About(symbol="h", text="share of a part's markers hidden in them")
    ] = 0.3
    hole_weight: Annotated[float, Field(ge=0), About(symbol="κ", text="weight of what is hidden")] = 0.1
    poses: Annotated[int, Field(ge=1), About(symbol="P", text="most training poses that are kept, drawn at random")] = (
        2000
    )
