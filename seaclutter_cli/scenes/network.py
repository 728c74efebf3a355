"""The network of S3, Fig. 2: a slim MobileNetV2. Its shape is here; PyTorch trains it, ONNX stores it."""

from dataclasses import dataclass
from typing import Any

STEM_MAPS = 3


@dataclass(frozen=True)
class BottleneckBlock:
    """A bottleneck: 1x1 convolution that widens, 3x3 depthwise, 1x1 that narrows; ReLU6 after the first two.

    Parameters
    ----------
    maps : int
        Maps that come out.
    stride : int
        Of the depthwise convolution.
    expansion : int
        How many times as many maps there are in between.
    """

    maps: int
    stride: int
    expansion: int = 4

    def is_residual(self, maps_in: int) -> bool:
        """Tell whether what comes in is added to what comes out."""
        return self.stride == 1 and self.maps == maps_in


BLOCKS = (
    BottleneckBlock(8, 2),
    BottleneckBlock(8, 1),
    BottleneckBlock(16, 2),
    BottleneckBlock(16, 1),
    BottleneckBlock(32, 2),
    BottleneckBlock(32, 1),
    BottleneckBlock(64, 2),
    BottleneckBlock(64, 1),
)
"""Bottlenecks and residual bottlenecks in turn, from 3 maps of 112 by 112 to 64 maps of 7 by 7.

The figure gives both ends and the kinds of layers; how many there are and how wide they are is ours.
"""


def make_network(classes: int) -> Any:
    """Return the network as a torch module with random weights.

    It takes images of shape (B, 1, 224, 224) as float32 of 0 and 1, and gives scores (B, classes) before softmax.
    """
    from torch import nn

    class Residual(nn.Sequential):  # type: ignore[misc]
        def forward(self, maps: Any) -> Any:
            return maps + super().forward(maps)

    layers = [_convolution(1, STEM_MAPS, 3, stride=2)]
    maps = STEM_MAPS
    for block in BLOCKS:
        wide = block.expansion * maps
        kind = Residual if block.is_residual(maps) else nn.Sequential
        layers.append(
            kind(
                _convolution(maps, wide, 1),
                _convolution(wide, wide, 3, stride=block.stride, groups=wide),
                _convolution(wide, block.maps, 1, activated=False),
            )
        )
        maps = block.maps
    return nn.Sequential(*layers, nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Linear(maps, classes))


def _convolution(
    maps_in: int, maps: int, size: int, *, stride: int = 1, groups: int = 1, activated: bool = True
) -> Any:
    from torch import nn

    convolution = nn.Conv2d(maps_in, maps, size, stride, size // 2, groups=groups, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(maps), *([nn.ReLU6()] if activated else []))
