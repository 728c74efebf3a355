"""Network of the scene classifier, a slim MobileNetV2 ([Bi], Fig. 2)."""

from dataclasses import dataclass
from typing import Any

STEM_MAPS = 3


@dataclass(frozen=True)
class BottleneckBlock:
    """A bottleneck: 1x1 expansion, 3x3 depthwise convolution, 1x1 projection; ReLU6 after the first two.

    Parameters
    ----------
    maps : int
        Number of output maps.
    stride : int
        Stride of the depthwise convolution.
    expansion : int
        Factor by which the expansion multiplies the number of maps.
    """

    maps: int
    stride: int
    expansion: int = 4

    def is_residual(self, maps_in: int) -> bool:
        """Return whether the input is added to the output."""
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
"""Alternating bottlenecks and residual bottlenecks, from 3 maps of 112 by 112 to 64 maps of 7 by 7.

The figure gives both ends and the types of the layers; their number and widths are our choice.
"""


def make_network(classes: int) -> Any:
    """Return the network as a torch module with random weights.

    Its input is images of shape (B, 1, 224, 224), float32, of 0 and 1; its output scores before softmax, shape (B, C).
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
