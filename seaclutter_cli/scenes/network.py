"""Network of the scene classifier, a slim MobileNetV2 ([Bi], Fig. 2), and its export to ONNX."""

import json
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli import __version__
from seaclutter_cli.scenes.model import CLASSES_KEY, EXTENT_KEY, IMAGE_SIZE

_STEM_MAPS = 3
_OPSET, _IR_VERSION = 17, 8  # from 2022, to be readable by older runtimes


_EXPANSION = 4
_BLOCKS = tuple(product((8, 16, 32, 64), (2, 1)))
"""Maps and stride of the bottlenecks, from 3 maps of 112 by 112 to 64 maps of 7 by 7; those of stride 1 are residual.

A bottleneck is a 1x1 expansion, a 3x3 depthwise convolution and a 1x1 projection, with ReLU6 after the first two. The
figure gives both ends and the types of the layers; their number and widths are our choice.
"""


def make_network(classes: int) -> Any:
    """Return the network as a torch module with random weights.

    Its input is images of shape (B, 1, 224, 224), float32, of 0 and 1; its output scores before softmax, shape (B, C).
    """
    from torch import nn

    class Residual(nn.Sequential):  # type: ignore[misc]
        def forward(self, maps: Any) -> Any:
            return maps + super().forward(maps)

    layers = [_convolution(1, _STEM_MAPS, 3, stride=2)]
    before = _STEM_MAPS
    for maps, stride in _BLOCKS:
        wide = _EXPANSION * before
        block = Residual if stride == 1 else nn.Sequential
        first, second = _convolution(before, wide, 1), _convolution(wide, wide, 3, stride=stride, groups=wide)
        layers.append(block(first, second, _convolution(wide, maps, 1, activated=False)))
        before = maps
    return nn.Sequential(*layers, nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Linear(maps, classes))


def _convolution(before: int, maps: int, size: int, *, stride: int = 1, groups: int = 1, activated: bool = True) -> Any:
    from torch import nn

    convolution = nn.Conv2d(before, maps, size, stride, size // 2, groups=groups, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(maps), *([nn.ReLU6()] if activated else []))


def to_onnx(network: Any, classes: Sequence[str], extent_m: float) -> bytes:
    """Return a network of `make_network` as the content of an ONNX file.

    Its input is images as bytes, shape (N, 1, 224, 224), its output probabilities, shape (N, C), float32. The metadata
    contains the class names and the extent. The same weights give the same bytes.
    """
    from onnx import TensorProto, checker, helper

    writer = _Writer()
    maps = writer.add("Cast", ["image"], to=TensorProto.FLOAT)
    maps = writer.convolution(maps, network[0])
    for (_, stride), layer in zip(_BLOCKS, network[1:], strict=False):
        before = maps
        for step in layer:
            maps = writer.convolution(maps, step)
        if stride == 1:
            maps = writer.add("Add", [before, maps])
    pooled = writer.add("Flatten", [writer.add("GlobalAveragePool", [maps])])
    last = network[-1]
    weights = [writer.weights(_array(values)) for values in (last.weight, last.bias)]
    scores = writer.add("Gemm", [pooled, *weights], transB=1)
    writer.nodes.append(helper.make_node("Softmax", [scores], ["probability"], axis=1))
    graph = helper.make_graph(
        writer.nodes,
        "scene",
        [helper.make_tensor_value_info("image", TensorProto.UINT8, ["N", 1, IMAGE_SIZE, IMAGE_SIZE])],
        [helper.make_tensor_value_info("probability", TensorProto.FLOAT, ["N", len(classes)])],
        writer.initializers,
    )
    opset = helper.make_opsetid("", _OPSET)
    model = helper.make_model(graph, producer_name="seaclutter", producer_version=__version__, opset_imports=[opset])
    model.ir_version = _IR_VERSION
    helper.set_model_props(model, {CLASSES_KEY: json.dumps(list(classes)), EXTENT_KEY: repr(float(extent_m))})
    checker.check_model(model, full_check=True)
    data: bytes = model.SerializeToString(deterministic=True)
    return data


class _Writer:
    """Nodes and weights of a graph under construction."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.initializers: list[Any] = []

    def add(self, kind: str, inputs: Sequence[str], **attributes: Any) -> str:
        from onnx import helper

        name = f"{kind.lower()}{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, list(inputs), [name], **attributes))
        return name

    def weights(self, values: NDArray[np.float32]) -> str:
        from onnx import numpy_helper

        name = f"weights{len(self.initializers)}"
        self.initializers.append(numpy_helper.from_array(values, name))
        return name

    def convolution(self, maps: str, step: Any) -> str:
        """Add a convolution with its batch normalisation and, if present, ReLU6; return the name of its output."""
        convolution, normal = step[0], step[1]
        scale = _array(normal.weight) / np.sqrt(_array(normal.running_var) + np.float32(normal.eps))
        kernel = _array(convolution.weight) * scale[:, None, None, None]
        bias = _array(normal.bias) - _array(normal.running_mean) * scale
        pad = convolution.padding[0]
        out = self.add(
            "Conv",
            [maps, self.weights(kernel), self.weights(bias)],
            kernel_shape=list(convolution.kernel_size),
            strides=list(convolution.stride),
            pads=[pad] * 4,
            group=convolution.groups,
        )
        if len(step) < 3:
            return out
        limits = (self.weights(np.array(limit, np.float32)) for limit in (0, 6))
        return self.add("Clip", [out, *limits])


def _array(tensor: Any) -> NDArray[np.float32]:
    values: NDArray[np.float32] = tensor.detach().cpu().numpy()
    return values
