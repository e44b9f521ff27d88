"""The order of the packages, and what each of them may know."""

import ast
import functools
import re
import subprocess
import sys
import typing
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import locplan

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "locplan"
ORDER = (
    {"errors"},
    {"_kernels"},
    {"_util"},
    {"maps"},
    {"robots"},
    {"field"},
    {"matching"},
    {"costs"},
    {"planners"},
    {"plotting"},
    {"simulation"},
    {"recordings"},
    {"landmarks"},
    {"comparison", "export", "paper"},
    {"mending"},
    {"diagnosis"},
    {"explorer"},
    {"testing"},
    {"cli"},
)
"""The packages from the bottom to the top; those in one row do not know of each other."""
LEVEL = {name: level for level, names in enumerate(ORDER) for name in names}
FACELESS = {"errors", "_kernels", "_util"}
"""Packages of which each module is a face; their names with an underscore are their own."""
HOMES = {
    "matplotlib": ("plotting", "_figures"),
    "ompl": ("planners.ompl._settings",),
    "yaml": ("_util.reading", "export._parameter_files"),
    "rosbags": ("recordings.bags",),
    "cloudpickle": ("comparison._workers",),
    "jinja2": ("_util.public",),
    "pandas": ("_util.records",),
    "cyclopts": ("cli",),
    "fcntl": ("comparison._journal", "_util.output"),
    "resource": ("comparison._perform",),
    "filelock": ("field._cache",),
    "distributed": (),
    "zipfile": ("_util.arrays",),
    "starlette": ("explorer._server", "explorer._socket"),
    "uvicorn": ("explorer._server",),
}
"""The modules, or the packages, that alone import a library; "_figures" ends a module's name."""


def modules() -> dict[str, Path]:
    """All modules by their name within the package; a package by the name of its folder."""
    names = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        names[".".join(part for part in parts if part != "__init__")] = path
    return names


MODULES = modules()


@functools.cache
def tree_of(path: Path) -> ast.Module:
    """What a file says."""
    return ast.parse(path.read_text())


@functools.cache
def imports_of(name: str) -> set[str]:
    """The modules that a module imports, at its top or later, those of ours without "locplan."."""
    path, found = MODULES[name], set()
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            ours = {f"{node.module}.{alias.name}".removeprefix("locplan.") for alias in node.names}
            found |= (ours & set(MODULES)) or {node.module}
    return {name.removeprefix("locplan.") for name in found}


def package_of(module: str) -> str:
    return module.split(".")[0]


def test_every_package_has_its_place():
    assert {package_of(name) for name in MODULES} - {"", "__main__"} == set(LEVEL)


@pytest.mark.parametrize("package", sorted(LEVEL))
def test_packages_import_from_lower_packages_only(package):
    for name in MODULES:
        if package_of(name) == package:
            for other in map(package_of, imports_of(name) - {"locplan"}):
                lower = LEVEL.get(other, -1) < LEVEL[package]
                assert lower or other == package, f"{name} imports {other}"


def is_on_face(module: str, name: str) -> bool:
    """Whether other packages may import a name from a module of ours."""
    if any(part.startswith("_") for part in (*module.split(".")[1:], name)):
        return False
    package, _, inner = module.partition(".")
    if package in FACELESS or package == "":
        return True
    face = getattr(locplan, package).__all__
    return name in face if not inner else inner.partition(".")[0] in face


def names_past_faces(module: str) -> list[str]:
    """The names that a module imports from other packages and that are not on their faces."""
    found = []
    for node in ast.walk(tree_of(MODULES[module])):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("locplan."):
            home = str(node.module).removeprefix("locplan.")
            if package_of(home) != package_of(module):
                names = [alias.name for alias in node.names]
                found += [f"{home}.{name}" for name in names if not is_on_face(home, name)]
    return found


@pytest.mark.parametrize("package", sorted(LEVEL))
def test_packages_import_from_the_faces_of_others_only(package):
    for name in MODULES:
        if package_of(name) == package:
            assert names_past_faces(name) == [], name


def test_only_commands_import_the_package_itself_and_others_its_version():
    for name, path in MODULES.items():
        if name not in ("", "__main__") and not name.startswith("cli."):
            for node in ast.walk(tree_of(path)):
                if isinstance(node, ast.ImportFrom) and node.module == "locplan":
                    names = {alias.name for alias in node.names} - {"__version__"}
                    assert names <= set(LEVEL), f"{name}: {names}"


def test_no_modules_import_each_other_in_a_circle():
    ours = {name: imports_of(name) & set(MODULES) - {name, ""} for name in MODULES if name}
    order = list(TopologicalSorter(ours).static_order())  # raises on a circle
    assert set(order) == set(ours)


def test_within_a_package_modules_import_each_other_by_their_own_names():
    for name, path in MODULES.items():
        if "." in name:
            own = f"from locplan.{package_of(name)} import "
            for line in path.read_text().splitlines():
                if line.strip().startswith(own) and ">>>" not in line:
                    what = line.strip().removeprefix(own).split(" as ")[0]
                    known = all(f"{package_of(name)}.{one}" in MODULES for one in what.split(", "))
                    assert known, f"{name}: {line.strip()}"


def test_modules_that_are_named_in_texts_are_lower_but_for_pictures_and_registries():
    for name, path in MODULES.items():
        for node in ast.walk(tree_of(path)):
            text = node.value if isinstance(node, ast.Constant) else None
            if isinstance(text, str) and re.fullmatch(r"locplan\.[\w.]+(:\w+)?", text):
                other = package_of(text.removeprefix("locplan."))
                picture = other == "plotting" and f'_drawn_by: ClassVar[str] = "{text}"'
                lower = LEVEL.get(other, -1) <= LEVEL.get(package_of(name), -1)
                assert lower or (picture and picture in path.read_text()), f"{name}: {text}"


@pytest.mark.parametrize("library", sorted(HOMES))
def test_some_libraries_have_one_home(library):
    for name in MODULES:
        at_home = any(
            name == home
            or name.startswith(f"{home}.")
            or (home.startswith("_") and name.endswith(home))
            for home in HOMES[library]
        )
        if not at_home:
            assert library not in map(package_of, imports_of(name)), name


@pytest.mark.parametrize("package", sorted(set(LEVEL) - FACELESS - {"cli"}))
def test_packages_offer_what_they_say(package):
    face = getattr(locplan, package)
    assert sorted(face.__all__) == sorted(set(face.__all__))
    for name in face.__all__:
        value = getattr(face, name)
        is_alias = typing.get_origin(value) is not None  # aliases of types have no docstring
        assert value.__doc__ or is_alias or name.isupper(), name


def test_package_folder_holds_few_modules():
    assert len(list(PACKAGE.glob("*.py"))) <= 5


def test_what_only_posix_has_is_imported_where_it_is_used():
    for name, path in MODULES.items():
        tops = [node for node in tree_of(path).body if isinstance(node, ast.Import)]
        names = {alias.name for node in tops for alias in node.names}
        assert not names & {"fcntl", "resource", "pwd", "grp", "termios"}, name


def test_the_command_line_starts_without_the_heavy_libraries():
    code = (
        "import sys, locplan.app.cli;"
        "heavy = {'numpy', 'numba', 'matplotlib', 'cv2', 'ompl', 'scipy'};"
        "print(sorted(heavy & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.strip() == "[]"
