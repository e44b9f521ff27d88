"""Build the documentation site: README, guides, gallery, results, reference, API and evidence.

Run: pip install 'locplan[docs]' && python examples/site.py FOLDER

The gallery and the results take minutes. FOLDER/.cache keeps them until a program changes, and
--quick leaves them out. A warning of Sphinx or a broken link ends the program with exit code 1.
"""

from __future__ import annotations

import argparse
import ast
import base64
import hashlib
import importlib
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import unquote, urlsplit

try:
    import reference
    from docutils import nodes
    from sphinx.application import Sphinx
    from sphinx.util.nodes import make_refnode
except ImportError as error:
    sys.exit(f"the site needs {error.name}; run pip install 'locplan[docs]'")

import locplan

EXAMPLES = Path(__file__).resolve().parent
PROJECT = EXAMPLES.parent
GUIDES = "examples/guides"
PAGES = {
    "README.md": "index",
    f"{GUIDES}/README.md": "guides/index",
    f"{GUIDES}/evidence.md": "evidence",
    "examples/README.md": "reference/programs",
    "examples/ros2/locplan_ros/README.md": "reference/ros_package",
    "CHANGELOG.md": "changes",
    "CONTRIBUTING.md": "contributing",
}
"""Page of the site for each page of the project; other guides keep their names."""
NAVIGATION = (
    ("Guides", "guides/index"),
    ("Gallery", "gallery/index"),
    ("Results", "results"),
    ("Reference", "reference/index"),
    ("API", "api/index"),
    ("Evidence", "evidence"),
    ("Changes", "changes"),
    ("Contributing", "contributing"),
)
"""Title and page of each entry at the top of the site."""
INDEX = {
    "commands": ("Commands", "the help of each command, and the exit codes"),
    "files": ("Files", "the files that each command writes"),
    "formats": ("Export formats", "files for Nav2 and ROS, with their options"),
    "settings": ("Robot settings", "names, defaults and units for `--set`"),
    "planners": ("Planners", "names and options for `--planner`"),
    "lidars": ("Lidars", "names and data for `--lidar`"),
    "dependencies": ("Dependencies", "libraries and their licences"),
    "benchmarks": ("Benchmarks", "speed, next to other programs"),
    "programs": ("Programs", "examples that write their results to a folder"),
    "ros_package": ("ROS 2 package", "nodes for masks, RViz and warnings"),
}
"""Title and content of each page of the reference."""
LANGUAGES = {".py": "python", ".yaml": "yaml", ".xml": "xml", ".toml": "toml", ".json": "json"}
"""Language of a source page by the suffix of its file."""
PICTURES = (".png", ".gif", ".svg", ".jpg")
DOWNLOADS = (".html", ".csv", ".yaml")
"""Suffixes of results that are copied as they are."""
STUB = ":::{note}\nThis site was built with `--quick`, which leaves out this page.\n:::\n"
SHARED_MAPS = ("hall", [32.2, 16.0], [4.3, 15.0]), ("two_corridors", [2.0, 3.0], [38.0, 3.0])
"""Maps of the shared pages of the explorer, with start and goal."""
CHECK = ("check", "two_corridors", "--lidar", "turtlebot4", "--effort", "quick", "-o", "report")
"""Command that writes the shown report."""


def main(*arguments: str) -> None:
    """Build the site into a folder; exit with 1 after a warning or a broken link."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("site"))
    parser.add_argument("--quick", action="store_true", help="leave out gallery and results")
    parser.add_argument("--external", action="store_true", help="check links to other sites")
    parser.add_argument(
        "--benchmarks", type=Path, metavar="JSON", help="file of tests/benchmarks/table.py"
    )
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as scratch:
        site = Site(options.folder.resolve(), Path(scratch))
        site.write_sources(options.benchmarks, is_quick=options.quick)
        failures = run_sphinx(site, "html")
        if options.external:
            failures += run_sphinx(site, "linkcheck")
    broken = find_broken_links(site.folder)
    print("\n".join(broken), file=sys.stderr)
    print(f"wrote {site.folder / 'index.html'}")
    if failures or broken:
        sys.exit(1)


@dataclass
class Site:
    """The site's folder, and the sources of its pages."""

    folder: Path
    scratch: Path
    """Folder of what only the build needs."""
    pages: dict[Path, str] = field(default_factory=dict)
    """Page of the site for each file of the project that has one."""
    waiting: list[Path] = field(default_factory=list)
    """Linked files of the project whose pages are not written yet."""

    @property
    def cache(self) -> Path:
        """Folder of results that take minutes."""
        return self.folder / ".cache"

    @property
    def sources(self) -> Path:
        """Folder of the sources of all pages."""
        return self.scratch / "sources"

    @property
    def extra(self) -> Path:
        """Folder of finished pages that Sphinx copies."""
        return self.scratch / "extra"

    def write_sources(self, benchmarks: Path | None = None, *, is_quick: bool = False) -> None:
        """Write the sources of all pages."""
        self.clear()
        for folder in (self.sources, self.extra):
            folder.mkdir()
        self.write("static/site.css", STYLE)
        guides = sorted(PROJECT.glob(f"{GUIDES}/*.md"))
        named = {str(guide.relative_to(PROJECT)): f"guides/{guide.stem}" for guide in guides}
        self.pages = {PROJECT / name: page for name, page in (named | PAGES).items()}
        self.write_api()
        self.write_reference(benchmarks)
        for source, page in list(self.pages.items()):
            if source.suffix == ".md" and source.exists():
                text = self.rewrite_links(source.read_text("utf-8"), source.parent, page)
                self.write(f"{page}.md", text + self.make_contents(page))
        self.write_gallery(is_quick)
        self.write_results(is_quick)
        while self.waiting:
            self.write_source_page(self.waiting.pop())

    def clear(self) -> None:
        """Remove an earlier site, but not its cache; exit if the folder holds other files."""
        self.folder.mkdir(parents=True, exist_ok=True)
        files = [file for file in self.folder.iterdir() if file != self.cache]
        if files and not (self.folder / ".buildinfo").exists():
            sys.exit(f"{self.folder} holds other files than a site; name another folder")
        for file in files:
            shutil.rmtree(file) if file.is_dir() else file.unlink()

    def write(self, name: str, text: str) -> None:
        """Write the source of a page."""
        file = self.sources / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, "utf-8")

    def write_reference(self, benchmarks: Path | None) -> None:
        """Write the pages that are generated from the code, and their index."""
        pages = reference.make_pages(benchmarks)
        commands = [f"commands/{name}" for name in reference.COMMANDS]
        pages["commands"] += make_toctree(*commands)
        for name, text in pages.items():
            self.write(f"reference/{name}.md", text)
        entries = [f"{title} <{name}>" for name, (title, _) in INDEX.items()]
        lines = [f"- [{title}]({name}.md): {use}\n" for name, (title, use) in INDEX.items()]
        self.write(
            "reference/index.md", "".join(["# Reference\n\n", *lines, make_toctree(*entries)])
        )

    def make_contents(self, page: str) -> str:
        """Return the hidden list of pages below a page."""
        if page == "index":
            return make_toctree(*(f"{title} <{name}>" for title, name in NAVIGATION))
        if page == "guides/index":
            guides = sorted(PROJECT.glob(f"{GUIDES}/*.md"))
            index = (PROJECT / GUIDES / "README.md").read_text("utf-8")
            names = [guide.stem for guide in guides if guide.stem not in ("README", "evidence")]
            names.sort(key=lambda name: index.find(f"({name}.md") % (len(index) + 1))
            return make_toctree(*names)
        return ""

    def rewrite_links(self, text: str, home: Path, page: str) -> str:
        """Return a page's text with its links to files of the project as links to pages."""

        def rewrite(match: re.Match[str]) -> str:
            link = match[2]
            if not re.match(r"[a-z]+:|#", link):
                target, hash_sign, anchor = link.partition("#")
                place = self.find_page((home / target).resolve())
                here = Path(page).parent
                link = Path(os.path.relpath(place, here)).as_posix() + hash_sign + anchor
            return f"{match[1]}{link})"

        parts = re.split(r"(^ *```.*?^ *```$|`[^`\n]*`)", text, flags=re.MULTILINE | re.DOTALL)
        parts[::2] = [re.sub(r"(\]\()([^)\s]+)\)", rewrite, part) for part in parts[::2]]
        return "".join(parts)

    def find_page(self, file: Path) -> str:
        """Return the source of the page of a project's file or folder, or its copied picture."""
        if not file.exists() or not file.is_relative_to(PROJECT):
            return f"missing/{file.name}"
        within = file.relative_to(PROJECT).as_posix()
        if file.suffix in PICTURES:
            copy = self.sources / "pictures" / within
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, copy)
            return f"pictures/{within}"
        file = file / "README.md" if (file / "README.md").exists() else file
        if file not in self.pages:
            self.pages[file] = f"source/{within.lstrip('.')}"  # GitHub omits hidden folders
            self.waiting.append(file)
        return f"{self.pages[file]}.{'rst' if self.pages[file].startswith('api/') else 'md'}"

    def write_source_page(self, file: Path) -> None:
        """Write the page of a program, another text file, or a folder."""
        page, within = self.pages[file], file.relative_to(PROJECT).as_posix()
        if file.suffix == ".ipynb":
            text = self.convert_notebook(file, page)
        elif file.suffix == ".md":
            text = self.rewrite_links(file.read_text("utf-8"), file.parent, page)
        elif file.is_dir():
            listed = subprocess.run(
                ["git", "ls-files", "."], cwd=file, capture_output=True, text=True, check=True
            )
            text = f"# {within}\n\n```text\n{listed.stdout}```\n"
        else:
            language = LANGUAGES.get(file.suffix, "text")
            fence = f"{{code-block}} {language}"
            text = f"# {within}\n\n``````{fence}\n{file.read_text('utf-8')}\n``````\n"
        self.write(f"{page}.md", f"---\norphan: true\n---\n\n{text}")

    def convert_notebook(self, file: Path, page: str) -> str:
        """Return an executed notebook as Markdown, and write its pictures."""
        parts = []
        for cell in json.loads(file.read_text("utf-8"))["cells"]:
            text = "".join(cell["source"])
            if cell["cell_type"] == "markdown":
                parts.append(self.rewrite_links(text, file.parent, page))
                continue
            parts.append(f"```python\n{text}\n```")
            for output in cell.get("outputs", ()):
                data = output.get("data", {"text/plain": output.get("text", "")})
                if "image/png" in data:
                    name = f"{file.stem}-{len(parts)}.png"
                    picture = self.sources / Path(page).parent / name
                    picture.parent.mkdir(parents=True, exist_ok=True)
                    picture.write_bytes(base64.b64decode("".join(data["image/png"])))
                    parts.append(f"![Output of the cell above]({name})")
                elif plain := "".join(data.get("text/plain", "")):
                    parts.append(f"```text\n{plain}\n```")
        return "\n\n".join(parts) + "\n"

    def write_gallery(self, is_quick: bool) -> None:
        """Write the page of all pictures with their commands."""
        page = f"# Gallery\n\n{STUB}"
        if not is_quick:
            results = self.keep("gallery", make_gallery)
            self.copy_results(results, "gallery")
            page = (results / "index.md").read_text("utf-8")
        self.write("gallery/index.md", page)

    def write_results(self, is_quick: bool) -> None:
        """Write the page of results that need no install."""
        parts = ["# Results without an install\n", STUB]
        maps = [name for name, *_ in SHARED_MAPS]
        if not is_quick:
            self.copy_results(self.keep("results", make_results), "results")
            parts[1:] = [
                "These files come from the commands. Each is one file that needs no server.\n",
                "## The explorer\n",
                "Move the pointer over the map to read the uncertainty. Pick another layer, or"
                " select a path.\n",
                "```sh\nlocplan explore hall --lidar turtlebot4\n```\n",
                *(make_frame(f"results/{name}.html", f"The map {name}") for name in maps),
                "## The report of a check\n",
                f"```sh\nlocplan {' '.join(CHECK)}\n```\n",
                make_frame("results/report/report.html", "The report"),
            ]
        self.write("results.md", "\n".join(parts))

    def keep(self, name: str, make: Callable[[Path], None]) -> Path:
        """Return a folder of results, made again if a program changed."""
        folder, stamp = self.cache / name, self.cache / f"{name}.sha256"
        digest = hashlib.sha256()
        for file in sorted([*(PROJECT / "locplan").rglob("*.py"), *EXAMPLES.glob("*.py")]):
            digest.update(file.read_bytes())
        if not stamp.exists() or stamp.read_text("utf-8") != digest.hexdigest():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            make(folder)
            stamp.write_text(digest.hexdigest(), "utf-8")
        return folder

    def copy_results(self, results: Path, name: str) -> None:
        """Copy the pictures of results to the sources, and their pages to the finished site."""
        for file in results.rglob("*"):
            if file.suffix in (*PICTURES, *DOWNLOADS):
                copy = (
                    (self.extra if file.suffix in DOWNLOADS else self.sources)
                    / name
                    / file.relative_to(results)
                )
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(file, copy)

    @cached_property
    def modules(self) -> dict[str, ModuleType]:
        """The public packages and modules by name."""
        return {module.__name__: module for module in list_modules()}

    @cached_property
    def homes(self) -> dict[object, str]:
        """Public name with the fewest dots of each public object, by its key."""
        names = sorted(
            (
                f"{package}.{name}"
                for package, module in self.modules.items()
                for name in list_names(module)
            ),
            key=lambda name: name.count("."),
        )
        homes: dict[object, str] = {}
        for name in names:
            package, _, last = name.rpartition(".")
            homes.setdefault(make_key(last, getattr(self.modules[package], last)), name)
        return homes

    def write_api(self) -> None:
        """Write a page for each public module, class, function and constant."""
        rows, entries = [], []
        for name, module in self.modules.items():
            self.pages[Path(module.__file__ or "").parent] = f"api/{name}"
            rows.append((f":doc:`{name}`", read_first_sentence(inspect.getdoc(module))))
            entries.append(name)
            self.write(f"api/{name}.rst", self.make_module_page(name, module))
        self.pages[PROJECT / "locplan"] = "api/locplan"
        intro = "Import ``locplan``. The packages load when you use them.\n\n"
        text = make_title("API") + intro + make_list_table(("package", "content"), rows)
        self.write("api/index.rst", text + make_rst_toctree(entries))

    def make_module_page(self, name: str, module: ModuleType) -> str:
        """Return the page of a module, and write the pages of its names."""
        described = defaultdict(list)
        written = []
        for last in list_names(module):
            thing = getattr(module, last)
            home = self.homes[make_key(last, thing)]
            if inspect.ismodule(thing):
                continue
            kind = "class" if inspect.isclass(thing) else "function" if callable(thing) else "data"
            doc = read_data_docs(module, last) if kind == "data" else inspect.getdoc(thing)
            described[kind].append((f":doc:`{last} <{home}>`", read_first_sentence(doc)))
            if home == f"{name}.{last}":
                written.append(home)
                self.write(f"api/{home}.rst", make_name_page(name, last, thing, kind, doc))
        text = make_title(name) + f".. py:module:: {name}\n\n{inspect.getdoc(module)}\n\n"
        for kind, title in KINDS.items():
            if described[kind]:
                text += f".. rubric:: {title}\n\n"
                text += make_list_table(("name", "meaning"), described[kind])
        return text + make_rst_toctree(written)


KINDS = {"class": "Classes", "function": "Functions", "data": "Constants"}


def make_gallery(folder: Path) -> None:
    """Draw the gallery into a folder."""
    subprocess.run([sys.executable, EXAMPLES / "gallery.py", folder], check=True)


def make_results(folder: Path) -> None:
    """Write the shared pages of the explorer and the report of a check into a folder."""
    for name, start, goal in SHARED_MAPS:
        grid = locplan.load_map(PROJECT / "maps" / f"{name}.yaml")
        robot = locplan.Robot("turtlebot4")
        with locplan.explore(grid, robot=robot, open_browser=False) as explorer:
            session = explorer.session
            session.wait()
            answer = session.answer("share", start=start, goal=goal, route="shared", view={})
            page = session.files.get(("download", answer["download"]))
            (folder / f"{name}.html").write_bytes(page.content)
    subprocess.run([sys.executable, "-m", "locplan", *CHECK], cwd=folder, check=True)


def make_frame(file: str, title: str) -> str:
    """Return a finished page in a frame, and a link to it."""
    frame = f'<iframe src="{file}" title="{title}" loading="lazy"></iframe>'
    return f'{frame}\n\n<a href="{file}">{title} without the frame</a>\n'


def list_modules(module: ModuleType = locplan) -> Iterator[ModuleType]:
    """Yield a package, and the public packages and modules below it."""
    yield module
    for name in getattr(module, "__all__", ()):
        thing = getattr(module, name)
        if inspect.ismodule(thing):
            yield from list_modules(thing)
    if module.__name__ == "locplan.planning":  # which does not name it, for it imports OMPL
        yield importlib.import_module("locplan.planning.ompl")


def list_names(module: ModuleType) -> list[str]:
    """Return the public names of a package, or of a module without `__all__`."""
    if hasattr(module, "__all__"):
        return [name for name in module.__all__ if not name.startswith("_")]
    return [
        name
        for name, thing in vars(module).items()
        if getattr(thing, "__module__", "") == module.__name__ and not name.startswith("_")
    ]


def make_key(name: str, thing: object) -> object:
    """Return the identity of a public object; equal numbers and texts may be one object."""
    return name if isinstance(thing, (int, str)) else id(thing)


def make_name_page(package: str, name: str, thing: object, kind: str, doc: str | None) -> str:
    """Return the page of a class, a function or a constant."""
    text = make_title(name) + f".. currentmodule:: {package}\n\n"
    if kind == "data":
        words = ", ".join(f"``{key}``" for key in thing) if isinstance(thing, dict) else ""
        value = f"   :value: {thing!r}\n" if isinstance(thing, (int, float, str)) else ""
        body = "\n".join(f"   {line}" for line in (doc or "").splitlines())
        return f"{text}.. py:data:: {name}\n{value}\n{body}\n\n   {words}\n"
    if kind == "function":
        return f"{text}.. autofunction:: {name}\n"
    return f"{text}.. autoclass:: {name}\n   :members:\n   :inherited-members: {FOREIGN}\n"


FOREIGN = "tuple, dict, object, Exception, Warning, Protocol"
"""Base classes whose members are not shown."""


def read_data_docs(module: ModuleType, name: str) -> str:
    """Return the docstring below a constant, in the module that defines it."""
    source = Path(module.__file__ or "")
    stub = source.with_suffix(".pyi")
    tree = ast.parse((stub if stub.exists() else source).read_text("utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and name in [alias.name for alias in node.names]:
            origin = "." * node.level + (node.module or "")
            return read_data_docs(importlib.import_module(origin, module.__package__), name)
    for node, following in zip(tree.body, tree.body[1:], strict=False):
        targets = getattr(node, "targets", [getattr(node, "target", None)])
        names = (
            [
                word.id
                for word in ast.walk(ast.Tuple(targets, ast.Store()))
                if isinstance(word, ast.Name)
            ]
            if targets != [None]
            else []
        )
        if name in names and isinstance(following, ast.Expr):
            return inspect.cleandoc(ast.literal_eval(following.value))
    raise LookupError(f"{module.__name__}.{name} has no docstring")


def read_first_sentence(doc: str | None) -> str:
    """Return the first sentence of a docstring."""
    paragraph = " ".join((doc or "").partition("\n\n")[0].split())
    return re.split(r"(?<=[^.]\.)\s", paragraph)[0]


def make_title(text: str) -> str:
    """Return a title of reStructuredText."""
    return f"{text}\n{'=' * len(text)}\n\n"


def make_list_table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a table of reStructuredText."""
    lines = [".. list-table::", "   :header-rows: 1", "   :widths: 25 75", ""]
    for row in (heads, *rows):
        lines += [f"   {'*' if n == 0 else ' '} - {cell}" for n, cell in enumerate(row)]
    return "\n".join(lines) + "\n\n"


def make_rst_toctree(pages: list[str]) -> str:
    """Return the hidden list of pages below a page of reStructuredText."""
    return "\n   ".join([".. toctree::", ":hidden:", "", *pages]) + "\n"


def make_toctree(*pages: str) -> str:
    """Return the hidden list of pages below a page of Markdown."""
    return "\n".join(["", "```{toctree}", ":hidden:", "", *pages, "```", ""])


def run_sphinx(site: Site, builder: str) -> int:
    """Build the site; return the number of warnings."""
    app = Sphinx(
        srcdir=site.sources,
        confdir=None,
        outdir=site.folder if builder == "html" else site.scratch / builder,
        doctreedir=site.scratch / "doctrees",
        buildername=builder,
        confoverrides={**SETTINGS, "html_extra_path": [str(site.extra)]},
        freshenv=True,
        status=None,
    )
    app.connect("autodoc-process-signature", remove_types)
    app.connect("missing-reference", find_public_name)
    app.build(force_all=True)
    return int(app._warncount) + int(app.statuscode != 0)


SETTINGS: dict[str, Any] = {
    "project": "locplan",
    "version": locplan.__version__,
    "release": locplan.__version__,
    "extensions": ["myst_parser", "sphinx.ext.autodoc", "numpydoc"],
    "exclude_patterns": ["static"],
    "smartquotes": False,  # options begin with two hyphens
    "default_role": "py:obj",
    "python_maximum_signature_line_length": 88,
    "autodoc_member_order": "bysource",
    "autodoc_preserve_defaults": True,
    "numpydoc_show_class_members": False,
    "myst_heading_anchors": 4,
    "html_theme": "pydata_sphinx_theme",
    "html_title": f"locplan {locplan.__version__}",
    "html_static_path": ["static"],
    "html_css_files": ["site.css"],
    "html_copy_source": False,
    "html_show_sourcelink": False,
    "html_sidebars": {"index": [], "gallery/index": [], "results": [], "evidence": []},
    "html_context": {"default_mode": "auto"},
    "html_theme_options": {
        "logo": {"text": "locplan"},
        "header_links_before_dropdown": 6,
        "show_prev_next": False,
        "footer_start": ["copyright"],
        "footer_end": [],
        "secondary_sidebar_items": {"results": [], "**": ["page-toc"]},
    },
    "copyright": f"the contributors of locplan {locplan.__version__}, Apache-2.0",
    "html_show_copyright": True,
}
"""Settings of Sphinx."""
STYLE = """
iframe { width: 100%; height: 46rem; border: 1px solid var(--pst-color-border) }
.bd-main .bd-content .bd-article-container:has(iframe) { max-width: 80em }
.highlight-sh pre, .highlight-console pre { white-space: pre-wrap; overflow-wrap: anywhere }
"""
"""Additions to the style of the theme."""


def remove_types(
    app: Sphinx, what: str, name: str, thing: object, options: object, args: str | None, kind: str
) -> tuple[str, str] | None:
    """Return a signature without types, which the section Parameters has."""
    if not args or what not in ("function", "method", "class"):
        return None
    try:
        (function,) = ast.parse(f"def f{args.replace('<factory>', '...')}: ...").body
    except SyntaxError:
        return None
    assert isinstance(function, ast.FunctionDef)
    for argument in ast.walk(function.args):
        if isinstance(argument, ast.arg):
            argument.annotation = None
    return f"({ast.unparse(function.args)})", ""


def find_public_name(app: Sphinx, env: Any, node: Any, text: nodes.Node) -> nodes.Node | None:
    """Return the link of a name in a docstring that is written without its package."""
    if node.get("refdomain") != "py" or not re.fullmatch(r"[\w.]+", node["reftarget"]):
        return None
    parts = node["reftarget"].removeprefix("locplan.").split(".")
    objects = env.domains.python_domain.objects
    for n in range(len(parts)):
        wanted = "." + ".".join(parts[n:])
        entries = {
            (entry.docname, entry.node_id)
            for name, entry in objects.items()
            if name.endswith(wanted)
            and (len(parts) - n > 1 or entry.objtype in ("class", "function", "data", "exception"))
        }
        if len(entries) == 1:
            ((page, anchor),) = entries
            return make_refnode(app.builder, node["refdoc"], page, anchor, text)
    return None


class LinkReader(HTMLParser):
    """The links of a built page, and its anchors."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Record the links and the anchor of a tag."""
        values = dict(attrs)
        self.anchors.add(values.get("id") or values.get("name") or "")
        self.links |= {values.get(name) or "" for name in ("href", "src")} - {""}


def find_broken_links(folder: Path) -> list[str]:
    """Return a line on each link of a built site that leads nowhere."""
    files = [
        file for file in sorted(folder.rglob("*.html")) if not {".cache", "_static"} & {*file.parts}
    ]
    pages = {file: LinkReader(file.read_text("utf-8")) for file in files}
    broken = []
    for file, page in pages.items():
        for link in sorted(page.links):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            anchors = pages[target].anchors if target in pages else None
            has_anchor = not parts.fragment or anchors is None or unquote(parts.fragment) in anchors
            if not target.exists() or not has_anchor:
                broken.append(f"{file.relative_to(folder)}: broken link {link}")
    return broken


if __name__ == "__main__":
    main(*sys.argv[1:])
