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


def linear(x: Array, w: Weights, name: str) -> Array:
    """``weight`` is kept transposed in the file."""
    return np.asarray(x @ w[f"{name}.weight"] + w[f"{name}.bias"])


def motion(x: Array, w: Weights) -> Array:
    return np.concatenate((w["motion_bones"] @ x[:, :-3], w["motion_way"] @ x[:, -3:]), axis=1)


def continued(x: Array, w: Weights) -> Array:
    return np.concatenate((w["base_bones"] @ x[:, :-3], w["base_way"] @ x[:, -3:]), axis=1)


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
    lively = np.sqrt((motion(x, w) ** 2).mean() + 1e-6)
    return continued(x, w) + lively * linear(ends, w, "out").reshape(10, 45)


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
    """Of one window (30, 45), number by number: directions of 14 bones, and the way."""
    out, moved = continued(x, w), motion(x, w) ** 2
    for first in range(0, 45, 3):
        lively = np.sqrt(moved[:, first : first + 3].mean() + 1e-6)
        part = "way" if first == 42 else "bones"
        for column in range(first, first + 3):
            y, k = (w[f"dct_{part}"] @ x[:, column]) / lively, 0
            while f"{part}{k}.weight" in w:
                y, k = np.maximum(linear(y, w, f"{part}{k}"), 0.0), k + 1
            out[:, column] += lively * linear(y, w, f"{part}_out")
    return out


def occlusion(x: Array, w: Weights) -> Array:
    """Of one window (30, 60)."""
    y = (w["dct"] @ x).ravel()
    for name in ("in", "code", "decode"):
        y = np.maximum(linear(y, w, name), 0.0)
    return np.asarray(w["dct_back"].T @ linear(y, w, "out").reshape(len(w["dct"]), -1))
