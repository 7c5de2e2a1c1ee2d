# /// script
# requires-python = ">=3.10"
# dependencies = ["onnx>=1.16", "numpy"]
# ///
"""Writes the network of the tests: crates/mtf/tests/data/edges.onnx.

Two layers of convolutions with fixed weights, for gray patches of any size: eight oriented derivative filters and a
bias each, ReLU, then a 3x3 smoothing filter per map. `uv run scripts/make_onnx.py [FILE]`.
"""

import math
import sys

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

MAPS = 8


def oriented(k: int) -> np.ndarray:
    """5x5 derivative of a Gaussian (sigma 1.2) along the angle k/MAPS of a turn, of unit L1 norm."""
    angle = 2 * math.pi * k / MAPS
    y, x = np.mgrid[-2:3, -2:3].astype(float)
    along = x * math.cos(angle) + y * math.sin(angle)
    w = along * np.exp(-(x**2 + y**2) / (2 * 1.2**2))
    return w / np.abs(w).sum()


def main() -> None:
    path = sys.argv[1] if len(sys.argv) > 1 else "crates/mtf/tests/data/edges.onnx"
    first = np.stack([oriented(k)[None] for k in range(MAPS)]).astype(np.float32)
    # A small bias keeps flat parts of a patch on the sloped side of the ReLU.
    bias = np.full(MAPS, 2.0, np.float32)
    tap = np.array([0.25, 0.5, 0.25])
    smooth = np.tile(np.outer(tap, tap)[None, None], (MAPS, 1, 1, 1)).astype(np.float32)
    weights = {"w1": first, "b1": bias, "w2": smooth}
    nodes = [
        helper.make_node("Conv", ["patch", "w1", "b1"], ["edges"], kernel_shape=[5, 5]),
        helper.make_node("Relu", ["edges"], ["lit"]),
        helper.make_node("Conv", ["lit", "w2"], ["maps"], kernel_shape=[3, 3], group=MAPS),
    ]
    value = helper.make_tensor_value_info
    graph = helper.make_graph(
        nodes,
        "edges",
        [value("patch", TensorProto.FLOAT, [1, 1, "h", "w"])],
        [value("maps", TensorProto.FLOAT, [1, MAPS, "h_out", "w_out"])],
        [numpy_helper.from_array(w, name) for name, w in weights.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, path)


main()
