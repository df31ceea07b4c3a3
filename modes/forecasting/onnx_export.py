"""Networks written as ONNX from their layers, node by node (extra ``train``): names are those of the layers.

Written by hand and not by torch's exporter: what is in the file stays as plain as the network, the same for
every version of torch, and ``tests`` can read it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.dataset import AHEAD, FEATURES, SEEN
from modes.forecasting.skeleton import JOINTS
from modes.forecasting.torch_networks import LEAST_MOTION, Sizes, TorchNetwork
from modes.forecasting.weights_file import INPUT, OUTPUT, SKELETON
from robots.errors import SetupError

_OPSET, _IR = 17, 8
_PARTS = {"bones": (0, FEATURES - 3), "way": (FEATURES - 3, FEATURES)}
"""Which features are directions of bones, and which the way of the root."""


class _Graph:
    """Nodes and weights of a network that is being written."""

    def __init__(self, network: TorchNetwork) -> None:
        try:
            import onnx
        except ImportError as error:
            raise SetupError("weights are written by onnx: pip install 'stopproof[train]'") from error
        self.onnx, self.nodes, self.weights = onnx, [], []  # type: tuple[Any, list[Any], list[Any]]
        self._state = {name: each.detach().numpy() for name, each in network.layers.state_dict().items()}
        self._named: set[str] = set()
        for name, matrix in network.constants.items():
            self.give(name, matrix.astype(np.float32))

    def give(self, name: str, values: NDArray[Any]) -> str:
        """Put an array into the file, once."""
        if name not in self._named:
            self._named.add(name)
            self.weights.append(self.onnx.numpy_helper.from_array(np.array(values, order="C"), name))
        return name

    def weight(self, name: str, *, transposed: bool = False) -> str:
        """Put a layer's weight into the file."""
        values = self._state[name]
        return self.give(name, values.T if transposed else values)

    def array(self, name: str) -> NDArray[Any]:
        """Return a layer's weight."""
        return np.asarray(self._state[name])

    def node(self, kind: str, inputs: list[str], output: str, **attributes: Any) -> str:
        """Add a node, and return the name of what it gives."""
        self.nodes.append(self.onnx.helper.make_node(kind, inputs, [output], name=output, **attributes))
        return output

    def linear(self, layer: str, x: str, output: str) -> str:
        """Add a layer on the last axis."""
        y = self.node("MatMul", [x, self.weight(f"{layer}.weight", transposed=True)], f"{output}_product")
        return self.node("Add", [y, self.weight(f"{layer}.bias")], output)

    def swap(self, x: str, output: str) -> str:
        """Swap frames and features."""
        return self.node("Transpose", [x], output, perm=[0, 2, 1])

    def reshape(self, x: str, shape: list[int], output: str) -> str:
        """Give it another shape; -1: windows."""
        return self.node(
            "Reshape", [x, self.give(f"{output}_shape", np.array(shape, dtype=np.int64))], output
        )

    def parts(self) -> dict[str, str]:
        """Cut what is seen into bones and way."""
        return {name: self.cut(INPUT, begin, end, 2, name) for name, (begin, end) in _PARTS.items()}

    def joined(self, kind: str, parts: dict[str, str]) -> str:
        """Multiply bones and way by the constant matrices of a kind, and join them."""
        found = [self.node("MatMul", [f"{kind}_{name}", x], f"{name}_{kind}") for name, x in parts.items()]
        return self.node("Concat", found, kind, axis=2)

    def root_of(self, mean: str) -> str:
        """Add the least motion to a mean square, and take the root."""
        least = self.give("least_motion", np.array(LEAST_MOTION, dtype=np.float32))
        return self.node("Sqrt", [self.node("Add", [mean, least], "mean_and_least")], "lively")

    def continued(self, parts: dict[str, str], lively: str, added: str) -> None:
        """Add the continuation of the last step and ``added`` in proportion to motion; give the sum."""
        base = self.joined("base", parts)
        self.node("Add", [base, self.node("Mul", [lively, added], "added")], OUTPUT)

    def cut(self, x: str, begin: int, end: int, axis: int, output: str) -> str:
        """Take a part along an axis."""
        at = [
            self.give(f"{output}_{name}", np.array([value], dtype=np.int64))
            for name, value in (("begin", begin), ("end", end), ("axis", axis))
        ]
        return self.node("Slice", [x, *at], output)


def write_onnx(network: TorchNetwork, sizes: Sizes, path: Path, described: dict[str, str]) -> None:
    """Write a network; ``described`` goes into the file beside the skeleton.

    Raises
    ------
    SetupError
        onnx is missing.
    """
    graph = _Graph(network)
    takes, gives = (SEEN, FEATURES), (AHEAD, FEATURES)
    if network.name == "bilstm":
        _write_bilstm(graph, sizes)
    elif network.name == "dct_mlp":
        _write_dct_mlp(graph, sizes)
    else:
        takes, gives = (SEEN, 4 * JOINTS), (SEEN, 3 * JOINTS)
        _write_occlusion(graph, sizes)
    helper, real = graph.onnx.helper, graph.onnx.TensorProto.FLOAT
    ends = [
        helper.make_tensor_value_info(name, real, ["n", *shape])
        for name, shape in ((INPUT, takes), (OUTPUT, gives))
    ]
    made = helper.make_graph(graph.nodes, network.name, ends[:1], ends[1:], graph.weights)
    model = helper.make_model(
        made, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=_IR, producer_name="stopproof"
    )
    helper.set_model_props(model, {"skeleton": SKELETON, **described})
    graph.onnx.checker.check_model(model, full_check=True)
    path.write_bytes(model.SerializeToString())


def _write_bilstm(graph: _Graph, sizes: Sizes) -> None:
    x = graph.swap(INPUT, "features_first")
    x = graph.node(
        "Conv", [x, graph.weight("conv.weight"), graph.weight("conv.bias")], "conv", auto_pad="SAME_UPPER"
    )
    x = graph.node("Transpose", [graph.node("Relu", [x], "conv_relu")], "frames_first", perm=[2, 0, 1])
    for k in range(sizes.layers):
        weights = [_both_directions(graph, f"lstm{k}", kind) for kind in ("W", "R", "B")]
        y = graph.node("LSTM", [x, *weights], f"lstm{k}", direction="bidirectional", hidden_size=sizes.hidden)
        y = graph.node("Transpose", [y], f"lstm{k}_by_frame", perm=[0, 2, 1, 3])
        x = graph.reshape(y, [SEEN, -1, 2 * sizes.hidden], f"lstm{k}_joined")
    ends = []
    for name, frame, begin in (("last_forward", SEEN - 1, 0), ("first_backward", 0, sizes.hidden)):
        row = graph.node(
            "Gather", [x, graph.give(f"{name}_frame", np.array(frame, dtype=np.int64))], f"{name}_row"
        )
        ends.append(graph.cut(row, begin, begin + sizes.hidden, 1, name))
    y = graph.linear("out", graph.node("Concat", ends, "ends", axis=1), "out")
    parts = graph.parts()
    motion = graph.joined("motion", parts)
    mean = graph.node("ReduceMean", [graph.node("Mul", [motion, motion], "squares")], "mean", axes=[1, 2])
    graph.continued(parts, graph.root_of(mean), graph.reshape(y, [-1, AHEAD, FEATURES], "by_frame"))


def _both_directions(graph: _Graph, layer: str, kind: str) -> str:
    """Put the weights of an LSTM into the file as ONNX has them: gates i, o, f, c; torch has i, f, c, o."""
    found = []
    for way in ("", "_reverse"):
        names = {"W": ["weight_ih"], "R": ["weight_hh"], "B": ["bias_ih", "bias_hh"]}[kind]
        for name in names:
            i, f, c, o = np.split(graph.array(f"{layer}.{name}_l0{way}"), 4)
            found.append(np.concatenate((i, o, f, c)))
    values = np.stack(found) if kind != "B" else np.concatenate(found).reshape(2, -1)
    return graph.give(f"{layer}.{kind}", values)


def _write_dct_mlp(graph: _Graph, sizes: Sizes) -> None:
    parts = graph.parts()
    motion = graph.joined("motion", parts)
    mean = graph.node("ReduceMean", [graph.node("Mul", [motion, motion], "squares")], "mean", axes=[1])
    lively = graph.root_of(graph.node("MatMul", [mean, "same_part"], "mean_of_part"))
    found = []
    for name, x in parts.items():
        size = graph.cut(lively, *_PARTS[name], 2, f"{name}_lively")
        y = graph.node(
            "Div", [graph.node("MatMul", [f"dct_{name}", x], f"{name}_cosines"), size], f"{name}_scaled"
        )
        y = graph.swap(y, f"{name}_by_number")
        for k in range(sizes.blocks):
            y = graph.node("Relu", [graph.linear(f"{name}{k}", y, f"{name}{k}")], f"{name}{k}_relu")
        found.append(graph.swap(graph.linear(f"{name}_out", y, f"{name}_out"), f"{name}_ahead"))
    graph.continued(parts, lively, graph.node("Concat", found, "ahead", axis=2))


def _write_occlusion(graph: _Graph, sizes: Sizes) -> None:
    x = graph.reshape(
        graph.node("MatMul", ["dct", INPUT], "cosines"), [-1, sizes.cosines * 4 * JOINTS], "flat"
    )
    for name in ("in", "code", "decode"):
        x = graph.node("Relu", [graph.linear(name, x, name)], f"{name}_relu")
    x = graph.reshape(graph.linear("out", x, "out"), [-1, sizes.cosines, 3 * JOINTS], "by_cosine")
    back = graph.node("Transpose", ["dct_back"], "frames_back", perm=[1, 0])
    graph.node("MatMul", [back, x], OUTPUT)
