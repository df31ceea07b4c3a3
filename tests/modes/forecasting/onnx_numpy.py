"""The shipped networks in plain NumPy: weights read from the bytes of ONNX files, and the same formulas."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Weights = dict[str, Array]

_GRAPH, _INITIALIZER = 7, 5
_DIMS, _TYPE, _NAME, _RAW = 1, 2, 8, 9
_KINDS = {1: np.float32, 7: np.int64}


def fields(data: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Numbers and values of a message of protocol buffers."""
    at = 0

    def number() -> int:
        nonlocal at
        value, shift = 0, 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    while at < len(data):
        key = number()
        if key & 7 == 0:
            yield key >> 3, number()
        elif key & 7 == 2:
            length = number()
            yield key >> 3, data[at : at + length]
            at += length
        else:
            at += {1: 8, 5: 4}[key & 7]


def read_weights(path: Path) -> Weights:
    """Weights of an ONNX file by their names."""
    found: Weights = {}
    for number, graph in fields(path.read_bytes()):
        if number != _GRAPH or isinstance(graph, int):
            continue
        for kind, tensor in fields(graph):
            if kind != _INITIALIZER or isinstance(tensor, int):
                continue
            dims: list[int] = []
            name, raw, element = "", b"", 1
            for key, value in fields(tensor):
                if key == _DIMS:
                    dims += _dims(value)
                elif key == _TYPE and isinstance(value, int):
                    element = value
                elif key == _NAME and isinstance(value, bytes):
                    name = value.decode()
                elif key == _RAW and isinstance(value, bytes):
                    raw = value
            found[name] = np.frombuffer(raw, _KINDS[element]).reshape(dims).astype(float)
    return found


def _dims(value: int | bytes) -> list[int]:
    if isinstance(value, int):
        return [value]
    return [int(number) for number in value] if all(byte < 0x80 for byte in value) else []


def sigmoid(x: Array) -> Array:
    return np.asarray(1.0 / (1.0 + np.exp(-x)))


def norm(x: Array, w: Weights, name: str) -> Array:
    centred = x - x.mean(axis=-1, keepdims=True)
    spread = np.sqrt((centred**2).mean(axis=-1, keepdims=True) + 1e-5)
    return np.asarray(centred / spread * w[f"{name}.weight"] + w[f"{name}.bias"])


def linear(x: Array, w: Weights, name: str) -> Array:
    """``weight`` is kept transposed in the file."""
    return np.asarray(x @ w[f"{name}.weight"] + w[f"{name}.bias"])


def continued(x: Array, w: Weights, added: Array) -> Array:
    bones, way = x[:, :-3], x[:, -3:]
    motion = np.concatenate((w["motion_bones"] @ bones, w["motion_way"] @ way), axis=1)
    lively = np.sqrt((motion**2).mean() + 1e-6)
    return np.concatenate((w["base_bones"] @ bones, w["base_way"] @ way), axis=1) + lively * added


def bilstm(x: Array, w: Weights) -> Array:
    """Of one window (30, 45)."""
    kernel = w["conv.weight"]
    reach = kernel.shape[2] // 2
    padded = np.pad(x, ((reach, reach), (0, 0)))
    y = np.stack([np.einsum("oik,ki->o", kernel, padded[t : t + 2 * reach + 1]) for t in range(len(x))])
    y = np.maximum(y + w["conv.bias"], 0.0)
    k = 0
    while f"lstm{k}.W" in w:
        y = np.concatenate([_lstm(y, w, k, way) for way in (0, 1)], axis=1)
        k += 1
    half = y.shape[1] // 2
    ends = np.concatenate((y[-1, :half], y[0, half:]))
    return continued(x, w, linear(ends, w, "out").reshape(10, 45))


def _lstm(x: Array, w: Weights, k: int, way: int) -> Array:
    """One direction; gates are input, output, forget, cell in an ONNX file."""
    W, R, B = w[f"lstm{k}.W"][way], w[f"lstm{k}.R"][way], w[f"lstm{k}.B"][way]
    bias = B[: len(W)] + B[len(W) :]
    cells = R.shape[1]
    h, c, out = np.zeros(cells), np.zeros(cells), np.zeros((len(x), cells))
    for t in range(len(x)) if way == 0 else reversed(range(len(x))):
        i, o, f, g = np.split(W @ x[t] + R @ h + bias, 4)
        c = sigmoid(f) * c + sigmoid(i) * np.tanh(g)
        h = sigmoid(o) * np.tanh(c)
        out[t] = h
    return out


def dct_mlp(x: Array, w: Weights) -> Array:
    """Of one window (30, 45)."""
    y = linear(w["dct"] @ x, w, "in")
    k = 0
    while f"norm_t{k}.weight" in w:
        y = y + linear(norm(y, w, f"norm_t{k}").T, w, f"mix_t{k}").T
        y = y + linear(np.maximum(linear(norm(y, w, f"norm_f{k}"), w, f"mix_f{k}"), 0.0), w, f"back_f{k}")
        k += 1
    y = linear(norm(y, w, "norm").T, w, "ahead").T
    return continued(x, w, linear(y, w, "out"))


def occlusion(x: Array, w: Weights) -> Array:
    """Of one window (30, 60)."""
    y = (w["dct"] @ x).ravel()
    for name in ("in", "code", "decode"):
        y = np.maximum(linear(y, w, name), 0.0)
    return np.asarray(w["dct"].T @ linear(y, w, "out").reshape(len(w["dct"]), -1))
