"""The packages: all folders of `ispom` and `app`. The folder `app` is installed as `ispom_app`, so that nobody's
site-packages gets a top-level module called `app`. All else is in pyproject.toml."""

from setuptools import find_packages, setup

app = find_packages("app", exclude=["*.tests"])
setup(
    packages=[*find_packages(include=["ispom", "ispom.*"]), "ispom_app", *(f"ispom_app.{name}" for name in app)],
    package_dir={"ispom_app": "app"},
)
