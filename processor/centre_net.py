"""The network of centres, told once: trained by JAX, written as ONNX for OpenCV.

A stem, three sizes with residual layers, and the way back up; 141,000 weights.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np

from processor.centres import INPUTS, OUTPUTS
from processor.net import Floats32

Weights = Mapping[str, tuple[Any, Any]]
"""Of each layer its kernel (k, k, inputs, outputs) and its bias (outputs,)."""

_OPSET: Final = 13  # of ONNX: old enough for every OpenCV that we take


@dataclass(frozen=True, slots=True)
class Layer:
    """A convolution; `gain` scales its first weights."""

    kernel: int
    inputs: int
    outputs: int
    stride: int = 1
    gain: float = 1.0


LAYERS: Final = {
    "stem": Layer(4, INPUTS, 16, 2), "fine": Layer(3, 16, 16),
    "down": Layer(3, 16, 32, 2), "middle1": Layer(3, 32, 32), "middle2": Layer(3, 32, 32, 1, 0.3),
    "down2": Layer(3, 32, 48, 2), "coarse1": Layer(3, 48, 48), "coarse2": Layer(3, 48, 48, 1, 0.3),
    "coarse3": Layer(3, 48, 48), "coarse4": Layer(3, 48, 48, 1, 0.3),
    "up": Layer(1, 48, 32, 1, 0.7), "middle3": Layer(3, 32, 32),
    "up2": Layer(1, 32, 24, 1, 0.7), "skip": Layer(1, 16, 24, 1, 0.7), "last": Layer(3, 24, 24),
    "head": Layer(1, 24, OUTPUTS, 1, 0.1),
}  # fmt: skip
RARE: Final = -3.5  # the first logit: most places are no centre


class Operations(Protocol):
    """What the network is made of, for arrays or for a graph."""

    def conv(self, layer: str, x: Any) -> Any:
        """A convolution and its bias."""

    def relu(self, x: Any) -> Any:
        """What is above zero."""

    def add(self, x: Any, y: Any) -> Any:
        """The sum."""

    def doubled(self, x: Any) -> Any:
        """Every pixel four times."""


def network(do: Operations, x: Any) -> Any:
    """Answer at half the size of the input."""

    def then(layer: str, x: Any) -> Any:
        return do.relu(do.conv(layer, x))

    def residual(one: str, two: str, x: Any) -> Any:
        return do.relu(do.add(x, do.conv(two, then(one, x))))

    fine = then("fine", then("stem", x))
    middle = residual("middle1", "middle2", then("down", fine))
    coarse = residual("coarse1", "coarse2", then("down2", middle))
    coarse = residual("coarse3", "coarse4", coarse)
    middle = then("middle3", do.relu(do.add(middle, do.doubled(do.conv("up", coarse)))))
    fine = do.relu(do.add(do.conv("skip", fine), do.doubled(do.conv("up2", middle))))
    return do.conv("head", then("last", fine))


def first_weights(seed: int) -> dict[str, tuple[Floats32, Floats32]]:
    """Random ones (He et al. 2015), before any training."""
    rng = np.random.default_rng(seed)
    made = {}
    for name, layer in LAYERS.items():
        shape = (layer.kernel, layer.kernel, layer.inputs, layer.outputs)
        spread = layer.gain * np.sqrt(2 / (layer.kernel**2 * layer.inputs))
        kernel = (rng.standard_normal(shape) * spread).astype(np.float32)
        made[name] = (kernel, np.zeros(layer.outputs, np.float32))
    made["head"][1][0] = RARE
    return made


def _padding(kernel: int) -> int:
    return 0 if kernel == 1 else 1


@dataclass(frozen=True, slots=True)
class OnArrays:
    """JAX arrays (N, H, W, C)."""

    weights: Weights

    def conv(self, layer: str, x: Any) -> Any:
        """A convolution and its bias."""
        import jax

        kernel, bias = self.weights[layer]
        padding = _padding(LAYERS[layer].kernel)
        stride = LAYERS[layer].stride
        made = jax.lax.conv_general_dilated(
            x, kernel, (stride, stride), ((padding, padding), (padding, padding)),
            dimension_numbers=("NHWC", "HWIO", "NHWC"),
        )  # fmt: skip
        return made + bias

    def relu(self, x: Any) -> Any:
        """What is above zero."""
        import jax

        return jax.nn.relu(x)

    def add(self, x: Any, y: Any) -> Any:
        """The sum."""
        return x + y

    def doubled(self, x: Any) -> Any:
        """Every pixel four times."""
        return x.repeat(2, 1).repeat(2, 2)


class OnGraph:
    """The same as nodes of an ONNX graph."""

    def __init__(self, weights: Weights) -> None:
        from onnx import numpy_helper

        self._weights = weights
        self._keep = numpy_helper.from_array
        self.nodes: list[Any] = []
        self.kept = [
            self._keep(np.array([], np.float32), "no_region"),
            self._keep(np.array([1, 1, 2, 2], np.float32), "twice"),
        ]

    def _node(self, kind: str, inputs: list[str], **attributes: Any) -> str:
        from onnx import helper

        name = f"{kind.lower()}{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, inputs, [name], **attributes))
        return name

    def conv(self, layer: str, x: str) -> str:
        """A convolution; ONNX has the kernel's outputs and inputs first."""
        kernel, bias = (np.asarray(part, np.float32) for part in self._weights[layer])
        ordered = np.ascontiguousarray(kernel.transpose(3, 2, 0, 1))
        self.kept += [self._keep(ordered, f"{layer}.kernel"), self._keep(bias, f"{layer}.bias")]
        size, stride = LAYERS[layer].kernel, LAYERS[layer].stride
        return self._node(
            "Conv", [x, f"{layer}.kernel", f"{layer}.bias"], kernel_shape=[size, size],
            strides=[stride, stride], pads=[_padding(size)] * 4,
        )  # fmt: skip

    def relu(self, x: str) -> str:
        """What is above zero."""
        return self._node("Relu", [x])

    def add(self, x: str, y: str) -> str:
        """The sum."""
        return self._node("Add", [x, y])

    def doubled(self, x: str) -> str:
        """Every pixel four times."""
        return self._node(
            "Resize", [x, "no_region", "twice"], mode="nearest", nearest_mode="floor",
            coordinate_transformation_mode="asymmetric",
        )  # fmt: skip


def to_onnx(weights: Weights, size_px: tuple[int, int]) -> bytes:
    """The network as an ONNX file, for pictures (width, height) of that or any other size."""
    from onnx import TensorProto, helper

    graph = OnGraph(weights)
    last = network(graph, "seen")
    width, height = size_px
    seen = helper.make_tensor_value_info("seen", TensorProto.FLOAT, [1, INPUTS, height, width])
    said = helper.make_tensor_value_info(
        last, TensorProto.FLOAT, [1, OUTPUTS, height // 2, width // 2]
    )
    made = helper.make_model(
        helper.make_graph(graph.nodes, "centres", [seen], [said], graph.kept),
        opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=8, producer_name="pomolog",
    )  # fmt: skip
    content: bytes = made.SerializeToString()
    return content
