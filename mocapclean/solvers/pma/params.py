"""The parameters of the method."""

from typing import Annotated, Literal

from mocapclean.parameters import About, Field, parameters

Predictor = Literal["local", "polynomial", "kernel", "linear", "pca"]


@parameters
class Params:
    """The predictors that are averaged, and their parameters."""

    methods: Annotated[
        tuple[Predictor, ...],
        Field(strict=False, min_length=1),
        About(symbol="M_i", text="the predictors that are averaged"),
    ] = ("local", "polynomial", "kernel", "linear", "pca")
    spread: Annotated[
        float, Field(gt=0), About(symbol="s", text="distance at which a weight of kernel is one half")
    ] = 0.3
    loosest: Annotated[
        float,
        Field(gt=0),
        About(symbol="σ_max", unit="mm", text="standard deviation of the distance to a marker that linear uses"),
    ] = 50.0
    bandwidth: Annotated[
        float, Field(gt=0), About(symbol="σ", unit="mm", text="decay with distance of the weights of pca")
    ] = 200.0
    space_constraint: Annotated[
        bool, About(symbol="c", text="keep the distances to the references within the known range")
    ] = True
    weight_window: Annotated[
        float, Field(ge=0), About(symbol="w", unit="s", text="window of the sliding median and mean of the weights")
    ] = 0.07
    output_filter: Annotated[
        float,
        Field(ge=0),
        About(symbol="f", unit="s", text="window of the sliding median and mean of the filled samples; 0: none"),
    ] = 0.0
