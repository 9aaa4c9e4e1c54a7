"""A user's own causes, as a user would write them: one acts through the camera, one through the water."""

from typing import Any, ClassVar

from mjfish.data import Trial
from mjfish.effects import Effect
from mjfish.effects.effect import Values
from mjfish.effects.mechanism import Domain
from mjfish.hydro.load import Load, load
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter


class CameraScale(Effect):
    """The camera's scale is off: translations are read (1 + error) times too large."""

    name: ClassVar[str] = "camera_scale"
    domain: ClassVar[Domain] = "data"
    summary: ClassVar[str] = "the scale of the camera is off"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("camera_scale.error", "-", 0.0, -0.3, 0.3, 0.0, 0.01, about="relative error of the scale"),
    )
    source: ClassVar[str] = "a calibration against a ruler"
    signature: ClassVar[str] = "surge and sway are off by the same factor, the yaw rate is right [all else equal]"
    confirm: ClassVar[str] = "film a ruler"

    def reading(self, state: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Scale the translations."""
        del trial
        read = state.copy()
        read[:, :2] *= 1.0 + values["error"]
        return read


@load
def _damping(link: Any, parameters: Any) -> tuple[float, float, float]:
    return -parameters[0] * link.u, 0.0, 0.0


class LinearDamping(Effect):
    """Every link is held back in proportion to its forward speed."""

    name: ClassVar[str] = "linear_damping"
    domain: ClassVar[Domain] = "water"
    summary: ClassVar[str] = "a damping along the body"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("linear_damping.coefficient", "N s/m", 0.0, 0.0, 5.0, 0.0, 0.05, about="of every link"),
    )
    source: ClassVar[str] = "a coast-down"
    signature: ClassVar[str] = "slower at low speed"
    confirm: ClassVar[str] = "let the fish coast"
    load: ClassVar[Load | None] = _damping
