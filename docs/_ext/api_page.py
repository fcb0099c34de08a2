"""The page of the public Python API: every name of `ispom.__all__`, by the part of the library that it comes from."""

from __future__ import annotations

import inspect

from stability import of_modules, of_name

GROUPS = {
    "In a notebook": ("ispom.notebook",),
    "Sequences and data": ("ispom.sequences", "ispom.types"),
    "Methods and runs": ("ispom.estimator", "ispom.methods", "ispom.ensemble", "ispom.settings", "ispom.errors"),
    "Sensors": ("ispom.sensors",),
    "Features": ("ispom.features",),
    "Geometry and solvers": ("ispom.geometry", "ispom.cameras", "ispom.solvers"),
    "Evaluation": ("ispom.evaluation",),
    "Tests of contracts, and the rest": ("ispom",),
}
INTRO = """# Python API

`import ispom` gives what plug-ins and notebooks need. Each part below is stable or experimental, and each
name says which. Modules below `ispom`, such as `ispom.solvers`, may change with each release.

```python
import ispom

sequence = ispom.open_sequence("sim:tiny")
methods = ispom.default_methods(sequence.rig)
ensemble = ispom.build(ispom.Config(), methods, sequence.rig)
state = ensemble.start()
for i in range(len(sequence)):
    state, steps = ensemble.step(state, sequence[i])
trajectories = ensemble.finish(state)  # by method
```
"""


def pages() -> dict[str, str]:
    """Returns the page with a directive for each public name."""
    import ispom

    left = dict(ispom._HOME_OF)
    text = [INTRO]
    for title, homes in GROUPS.items():
        mine = [name for name in sorted(left) if any(f"{left[name]}.".startswith(f"{home}.") for home in homes)]
        if not mine:
            continue
        directives = []
        for name in mine:
            value = getattr(ispom, name)
            kind = "class" if inspect.isclass(value) else "function" if callable(value) else "data"
            options = {"class": "\n   :members:\n   :undoc-members:", "data": "\n   :no-value:"}.get(kind, "")
            directives.append(f".. auto{kind}:: ispom.{name}{options}\n\n   {of_name(left.pop(name))}")
        text += [f"## {title}", of_modules(homes, "../"), "```{eval-rst}\n" + "\n\n".join(directives) + "\n```"]
    return {"reference/python_api.md": "\n\n".join(text)}
