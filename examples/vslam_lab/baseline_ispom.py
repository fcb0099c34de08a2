"""For VSLAM-LAB's folder `Baselines/baseline_files`: how it starts ISPOM."""

from Baselines.BaselineVSLAMLAB import BaselineVSLAMLAB


class ISPOM_baseline(BaselineVSLAMLAB):
    """ISPOM helper for VSLAM-LAB Baselines. ISPOM comes from PyPI; this folder holds its entry script and settings."""

    def __init__(self, baseline_name: str = "ispom", baseline_folder: str = "ISPOM") -> None:
        super().__init__(baseline_name, baseline_folder, {"verbose": 1, "mode": "mono"})
        self.color = (0.0, 0.62, 0.45)
        self.modes = ["mono", "stereo"]
        self.cam_models = ["pinhole", "radtan4", "radtan5", "equid4", "unknown"]
        self.command_style = "python"

    def is_installed(self) -> tuple[bool, str]:
        installed = (self.baseline_path / "vslamlab_ispom.py").is_file()
        return (True, "is installed") if installed else (False, f"copy examples/vslam_lab to {self.baseline_path}")

    def fetch_source(self) -> None:
        """Nothing is cloned: the three files are copied by hand, see README.md."""
        self.ensure_pixi_env()
