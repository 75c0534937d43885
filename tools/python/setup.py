"""Python's package from this repository: pip install --no-build-isolation tools/python/

Builds the module by CMake and Ninja, in build/python-wheel; tools/setup.sh installs what that
needs. LOCVOL_BUILD names a build directory that is configured already, such as build/release.
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys

from setuptools import Distribution, Extension, setup
from setuptools.command.build_ext import build_ext

HERE = pathlib.Path(__file__).parent.resolve()
ROOT = HERE.parent.parent
VERSION = re.search(r"project\(locvol VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text())[1]


class BuildByCMake(build_ext):
    def build_extension(self, ext):
        build = os.environ.get("LOCVOL_BUILD")
        if build is None:
            build = ROOT / "build" / "python-wheel"
            subprocess.run(
                ["cmake", "-S", ROOT, "-B", build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release",
                 "-DLOCVOL_TESTS=OFF", "-DLOCVOL_PYTHON=ON", "-DCMAKE_UNITY_BUILD=ON",
                 f"-DPython3_EXECUTABLE={sys.executable}"], check=True)  # fmt: skip
        subprocess.run(["cmake", "--build", build, "--target", "locvol_python"], check=True)
        wanted = pathlib.Path(self.get_ext_fullpath(ext.name))
        built = pathlib.Path(build) / "tools" / "python" / "locvol" / wanted.name
        if not built.exists():
            raise RuntimeError(f"{built} was not built: is pybind11-dev there, for this Python?")
        wanted.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(built, wanted)
        subprocess.run(["strip", wanted], check=True)


class WithModule(Distribution):
    def has_ext_modules(self):
        return True


setup(
    name="locvol",
    version=VERSION,
    description="Tetrahedral meshes of closed surfaces, out of core",
    license="GPL-3.0-or-later",
    python_requires=">=3.10",
    install_requires=["numpy"],
    packages=["locvol"],
    package_data={"locvol": ["py.typed", "*.pyi"]},
    ext_modules=[Extension("locvol._locvol", [])],
    cmdclass={"build_ext": BuildByCMake},
    distclass=WithModule,
    entry_points=(HERE / "entry_points.txt").read_text(),
)
