"""Networks read from ONNX files: their shapes and their skeleton are those that they are used for.

The package has three of them in ``modes/forecasting/weights``; onnxruntime (extra ``forecast``) runs them on
one core.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.skeleton import BONES, Joint
from robots.errors import SetupError

Array = NDArray[np.float64]

WEIGHTS = Path(__file__).parent / "weights"
INPUT, OUTPUT = "history", "future"
SKELETON = " ".join(each.name for each in Joint) + "; " + " ".join(f"{a.name}-{b.name}" for a, b in BONES)
"""What weights say of the joints and bones that they were trained on."""


class Network:
    """A network of an ONNX file.

    Parameters
    ----------
    path:
        Of the file.

    Raises
    ------
    SetupError
        onnxruntime is missing, it is no such file, or the weights are of another skeleton.
    """

    def __init__(self, path: Path) -> None:
        try:
            import onnxruntime
        except ImportError as error:
            raise SetupError(
                "forecasts by networks need onnxruntime: pip install 'stopproof[forecast]'"
            ) from error
        if not path.is_file():
            raise SetupError(f"{path.name}: no such file of weights in {path.parent}")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        failures = onnxruntime.capi.onnxruntime_pybind11_state
        try:
            self._session: Any = onnxruntime.InferenceSession(
                path.read_bytes(), options, providers=["CPUExecutionProvider"]
            )
        except (
            failures.InvalidProtobuf,
            failures.InvalidGraph,
            failures.Fail,
            failures.InvalidArgument,
        ) as error:
            said = " ".join(str(error).split())
            raise SetupError(f"{path.name}: no network of ONNX: {said[:120]}") from error
        self.name = path.name
        described = self._session.get_modelmeta().custom_metadata_map
        if described.get("skeleton") != SKELETON:
            found = described.get("skeleton", "none")
            raise SetupError(f"{path.name}: weights of another skeleton ({found[:80]}), not of the 15 joints")

    def require_shapes(self, takes: tuple[int, int], gives: tuple[int, int]) -> None:
        """Refuse a network that does not take and give ``(n, frames, features)`` of these numbers.

        Raises
        ------
        SetupError
            It does not.
        """
        ends = self._session.get_inputs(), self._session.get_outputs()
        for what, each, name, wanted in zip(
            ("takes", "gives"), ends, (INPUT, OUTPUT), (takes, gives), strict=True
        ):
            found = {end.name: tuple(end.shape[1:]) for end in each}
            if found != {name: wanted}:
                raise SetupError(
                    f"{self.name}: weights of another shape: {what} {found}, not {name} {wanted}"
                )

    def run(self, values: Array) -> Array:
        """Return what it gives ``(n, frames, features)`` for ``values`` (n, frames, features)."""
        (given,) = self._session.run([OUTPUT], {INPUT: values.astype(np.float32)})
        return np.asarray(given, dtype=float)


def load_network(
    name: str, takes: tuple[int, int], gives: tuple[int, int], folder: Path = WEIGHTS
) -> Network:
    """Return the network ``name.onnx`` of a folder, or of the package, of these shapes.

    Raises
    ------
    SetupError
        It is missing or another one.
    """
    network = Network(folder / f"{name}.onnx")
    network.require_shapes(takes, gives)
    return network
