"""A lesson on the stand-in sequence."""

from __future__ import annotations

from ispom_app.features.lessons.lesson_file import read_lesson

TEXT = """---
title: Stand-ins
minutes: 5
source: double:40
methods: [stereo.paper, monocular.paper]
---
About stand-ins.

## Choose

Which?

```step
at: 5
hidden: [truth]
choose:
  It is exact: error < 0.001
  It is wrong: error >= 0.001
runs:
  other: {methods: [stereo.paper], source: double:45}
values:
  error: ate_m(this, stereo.paper, se3)
  poses: poses_per_s(other, stereo.paper)
claims: [error < 0.001]
```

Off by {error:.3f} m, {poses:.1f} poses a second.

## Give a number

How many?

```step
at: 8
to: 15
number: {value: count, unit: tracks, within: 1}
values:
  count: median(this, stereo.paper.inliers)
claims: [count > 1000]
```

{count:.0f}.

## Point

Click.

```step
at: 8
to: 8
point: {camera: video, right: track.dropped}
```

So.

## Draw

Draw it.

```step
at: 8
draw:
  curve: error_curve(this, monocular.paper, sim3)
  x: time [s]
  y: error [m]
  x_range: [0, 1]
  y_range: [0, 1]
  within: 0.1
tools: true
```

So.

## What cannot be computed

Give it.

```step
at: 8
number: {value: clock}
values:
  clock: clock_ms(this, stereo.paper)
```

{clock:.0f}
"""
LESSON = read_lesson("stand-ins", TEXT)
