#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Makes config.ocio and aces-like.spi1d beside this file. Standard library only; the output is checked in.

The ACES-like view is Narkowicz's rational fit (2016) to the ACES tone curve, per channel, then the sRGB encoding:
    f(x) = x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14), clamped to [0, 1].
OpenColorIO 2.1 has no rational function, so it is tabulated over u = (log2(x + 2^-8) + 8) / 15, x in [0, 128).
"""
import os

SIZE, OFFSET, LOW, HIGH = 4096, 2.0**-8, -8.0, 7.0


def curve(x):
    return min(1.0, max(0.0, x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)))


def encode(v):
    return 12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055


CONFIG = """\
# Made by make-config.py. For OpenColorIO 2.1 and later.
ocio_profile_version: 2

description: Scene-linear Rec. 709 to an sRGB display, plain or through an ACES-like tone curve.
search_path: .
strictparsing: true
luma: [0.2126, 0.7152, 0.0722]

roles:
  color_picking: sRGB
  data: Raw
  default: Linear Rec.709
  scene_linear: Linear Rec.709

file_rules:
  - !<Rule> {name: Default, colorspace: default}

displays:
  sRGB:
    - !<View> {name: ACES-like, colorspace: sRGB ACES-like}
    - !<View> {name: sRGB, colorspace: sRGB}
    - !<View> {name: Raw, colorspace: Raw}

active_displays: [sRGB]
active_views: [ACES-like, sRGB, Raw]

colorspaces:
  - !<ColorSpace>
    name: Linear Rec.709
    family: Scene
    bitdepth: 32f
    description: Linear radiance, Rec. 709 primaries, D65.
    isdata: false
    allocation: lg2
    allocationvars: [-8, 7, %(offset)s]

  - !<ColorSpace>
    name: sRGB
    family: Display
    bitdepth: 32f
    description: The sRGB encoding of linear values, clipped to [0, 1].
    isdata: false
    allocation: uniform
    allocationvars: [0, 1]
    from_scene_reference: !<GroupTransform>
      children:
        - !<RangeTransform> {min_in_value: 0, max_in_value: 1, min_out_value: 0, max_out_value: 1}
        - !<ExponentWithLinearTransform> {gamma: 2.4, offset: 0.055, direction: inverse}

  - !<ColorSpace>
    name: sRGB ACES-like
    family: Display
    bitdepth: 32f
    description: Narkowicz's fit to the ACES tone curve, per channel, then the sRGB encoding.
    isdata: false
    allocation: uniform
    allocationvars: [0, 1]
    from_scene_reference: !<GroupTransform>
      children:
        - !<RangeTransform> {min_in_value: 0, max_in_value: 127, min_out_value: 0, max_out_value: 127}
        - !<AllocationTransform> {allocation: lg2, vars: [%(low)g, %(high)g, %(offset)s]}
        - !<FileTransform> {src: aces-like.spi1d, interpolation: linear}

  - !<ColorSpace>
    name: Raw
    family: Utility
    bitdepth: 32f
    description: No transform.
    isdata: true
    allocation: uniform
"""


def main():
    here = os.path.dirname(os.path.abspath(__file__))
    with open(os.path.join(here, "aces-like.spi1d"), "w") as out:
        out.write("Version 1\nFrom 0 1\nLength %d\nComponents 1\n{\n" % SIZE)
        for i in range(SIZE):
            x = max(0.0, 2.0 ** (LOW + (HIGH - LOW) * i / (SIZE - 1)) - OFFSET)
            out.write("%.7f\n" % encode(curve(x)))
        out.write("}\n")
    with open(os.path.join(here, "config.ocio"), "w") as out:
        out.write(CONFIG % {"offset": repr(OFFSET), "low": LOW, "high": HIGH})


if __name__ == "__main__":
    main()
