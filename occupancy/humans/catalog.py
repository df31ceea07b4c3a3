"""The models of people by their names, and which of them follow from a profile."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from occupancy.body import Profile
from occupancy.humans.arm_reach import ArmReach
from occupancy.humans.articulated import ArticulatedAcceleration, ArticulatedPosition, ArticulatedVelocity
from occupancy.humans.iso13855 import Iso13855
from occupancy.humans.model import HumanModel
from occupancy.humans.options import ModelError
from occupancy.humans.pedestrian import Pedestrian

_MAKERS: dict[str, Callable[[Profile, float | None, int], HumanModel]] = {
    "iso13855": lambda profile, held, index: Iso13855(profile, held_object_m=held, index=index),
    "articulated_velocity": lambda profile, held, index: ArticulatedVelocity(
        profile, held_object_m=held, index=index
    ),
    "articulated_acceleration": lambda profile, held, index: ArticulatedAcceleration(
        profile, held_object_m=held, index=index
    ),
    "arm_reach": lambda profile, held, index: ArmReach(profile, held_object_m=held, index=index),
    "articulated_position": lambda profile, held, index: ArticulatedPosition(
        profile, held_object_m=held, index=index
    ),
    "pedestrian": lambda profile, held, index: Pedestrian(profile, held_object_m=held, index=index),
}
"""In the order in which a check asks them: what proves most for the least first."""

MODEL_NAMES: tuple[str, ...] = tuple(_MAKERS)


def build_models(
    profile: Profile, names: Sequence[str], held_object_m: float | None = None
) -> tuple[HumanModel, ...]:
    """Make the models of people that a cell enables, in the order in which a check asks them.

    Parameters
    ----------
    profile:
        The one profile that all of them follow from: a model that believed less would delete what another
        one assumes (docs/method.md, section 4).
    names:
        Of the models.
    held_object_m:
        How far an object in either hand reaches beyond it [m]; ``None``: not declared, 0.

    Raises
    ------
    ModelError
        A name is not known, stands there twice, or the model does not follow from the profile.
    """
    for name in profile.models:
        if name not in (*_MAKERS, "unobserved"):
            raise ModelError(
                f"profile {profile.name} names a model {name!r} that is not known; known: "
                f"{', '.join((*MODEL_NAMES, 'unobserved'))}"
            )
    for name in names:
        if name not in _MAKERS:
            raise ModelError(f"there is no model of people {name!r}; known: {', '.join(MODEL_NAMES)}")
        if name not in profile.models:
            raise ModelError(
                f"model {name} does not follow from profile {profile.name}; "
                f"these do: {', '.join(each for each in profile.models if each in _MAKERS)}"
            )
    if len(set(names)) < len(names) or not names:
        raise ModelError(f"models of people {', '.join(names)}: name each once, at least one")
    ordered = [name for name in _MAKERS if name in names]
    return tuple(_MAKERS[name](profile, held_object_m, index) for index, name in enumerate(ordered))
