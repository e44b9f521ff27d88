"""The layout of the code: names of modules, public names, kernels, and imports that stay light."""

import ast
import functools
import re
import subprocess
import sys
from pathlib import Path

import pytest

import locplan

PACKAGE = Path(locplan.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))
PACKAGES = sorted(
    path.parent.name
    for path in PACKAGE.glob("*/__init__.py")
    if path.parent.name not in ("_support", "app")
)
HEAVY = {"numba", "matplotlib", "ompl", "pandas", "scipy.optimize"}
POSIX = {"fcntl", "resource", "pwd", "grp", "termios"}


@functools.cache
def parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def test_modules_have_plain_names():
    names = [path.stem for path in MODULES if path.parent != PACKAGE]
    assert [name for name in names if name.startswith("_") and name != "__init__"] == []


@pytest.mark.parametrize("package", PACKAGES)
def test_package_exports_at_most_30_names(package):
    names = __import__(f"locplan.{package}", fromlist=["__all__"]).__all__
    assert len(names) <= 30


def test_locplan_exports_at_most_50_names():
    stub = ast.parse((PACKAGE / "__init__.pyi").read_text("utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    names = [alias.name for node in imports if node.module for alias in node.names]
    assert len(names) <= 50


def test_strings_name_no_module():
    """Tools that follow imports do not see such a name."""
    for path in MODULES:
        assert not re.search(r"""["']locplan(\.\w+)+:\w+["']""", path.read_text("utf-8")), path


def test_kernels_stand_in_folders_of_kernels():
    """The digest of the kernel cache covers these folders only (_support/compilation.py)."""
    for path in MODULES:
        if path.parent.name != "kernels":
            assert not re.search(r"^@(numba\.)?n?jit|import njit", path.read_text(), re.M), path


def test_kernels_use_compiler_of_package():
    """numba itself fails if an installed package and the user's home cannot be written."""
    for path in MODULES:
        imports = [node for node in ast.walk(parse(path)) if isinstance(node, ast.ImportFrom)]
        names = {alias.name for node in imports if node.module == "numba" for alias in node.names}
        assert not names & {"jit", "njit"}, path


def test_names_of_tests_are_short():
    """Docstrings give reasons; a name has at most six words, eight with a condition."""
    for path in Path(__file__).parents[1].rglob("test_*.py"):
        for node in ast.walk(parse(path)):
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                words = node.name.split("_")[1:]
                assert len(words) <= (8 if "if" in words else 6), f"{path}: {node.name}"
                assert not {"a", "an", "the"} & set(words), f"{path}: {node.name}"


def test_only_command_line_prints():
    """The library logs instead, and its callers decide what is shown."""
    command_line = {PACKAGE / "__main__.py", *(PACKAGE / "app" / "cli").glob("*.py")}
    for path in set(MODULES) - command_line:
        calls = [node.func for node in ast.walk(parse(path)) if isinstance(node, ast.Call)]
        assert "print" not in [func.id for func in calls if isinstance(func, ast.Name)], path


def test_package_imports_load_no_heavy_library():
    packages = ("maps", "robots", "field", "planning", "simulation")
    imports = ", ".join(f"locplan.{package}" for package in packages)
    code = f"import sys, {imports}; print(sorted({HEAVY} & set(sys.modules)))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.strip() == "[]", result.stderr


def test_posix_modules_are_imported_lazily():
    for path in MODULES:
        imports = re.findall(r"^import (.+)$", path.read_text("utf-8"), re.MULTILINE)
        assert not set(re.findall(r"\w+", " ".join(imports))) & POSIX, path


def find_calls(name: str) -> list[tuple[Path, ast.Call]]:
    """Return the calls of functions and methods of this name in the package."""
    nodes = ((path, node) for path in MODULES for node in ast.walk(parse(path)))
    calls = [(path, node) for path, node in nodes if isinstance(node, ast.Call)]
    return [(path, call) for path, call in calls if ast.unparse(call.func).endswith(f".{name}")]


def list_keywords(call: ast.Call) -> set[str | None]:
    return {keyword.arg for keyword in call.keywords}


def test_texts_have_same_line_ends_everywhere():
    """Windows writes two characters for each line end, unless `newline` says otherwise."""
    writers = [*find_calls("write_text"), *find_calls("open")]
    modes = ("'w'", "'a'", "'a+'", "'x'", "'wt'")
    assert len(writers) > 3
    for path, call in writers:
        arguments = [ast.unparse(argument) for argument in call.args]
        is_writer = call.func.attr == "write_text" or any(mode in arguments for mode in modes)
        if is_writer and not ast.unparse(call.func).startswith("archive."):
            assert list_keywords(call) >= {"newline"}, f"{path}:{call.lineno}"
    for path, call in find_calls("savetxt"):  # for a path, it opens the file itself
        assert ast.unparse(call.args[0]) in ("file", "target"), f"{path}:{call.lineno}"


def test_text_is_read_with_encoding():
    """Windows reads a text in the encoding of its language unless one is named."""
    readers = find_calls("read_text")
    assert readers
    for path, call in readers:
        assert call.args or "encoding" in list_keywords(call), f"{path}:{call.lineno}"


def test_argsort_calls_name_sorting_algorithm():
    """Otherwise numpy's order of equal values depends on the processor."""
    calls = find_calls("argsort")
    assert len(calls) > 10
    for path, call in calls:
        if path.parent.name != "kernels":  # numba has one way, the same everywhere
            assert list_keywords(call) >= {"kind"}, f"{path}:{call.lineno}"


def test_command_line_starts_without_heavy_libraries():
    code = f"import sys, locplan.app.cli; print(sorted({HEAVY} & set(sys.modules)))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.strip() == "[]", result.stderr


def test_lost_limit_stands_once():
    """Texts take it from `LOST_TEXT` and `LOST_SHORT_TEXT`, so that one edit changes all."""
    pattern = r"(?:off by|error of|error) (?:more than|over|>) [\d.]+ m\b|\d m off\b"
    for path in [*MODULES, *PACKAGE.rglob("*.html"), *PACKAGE.rglob("*.js")]:
        assert not re.search(pattern, path.read_text("utf-8")), path
