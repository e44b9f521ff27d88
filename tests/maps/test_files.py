"""Reading and writing map_server files: what a pixel means, and what is refused."""

from __future__ import annotations

import math
import os
import re
import struct
import tracemalloc
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageFile
from support.machine import respects_permissions
from support.maps import ascii_map

from locplan.errors import MapError
from locplan.maps import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    MapWarning,
    OccupancyGrid,
    files as pixels,
    find_maps,
    load_map,
    save_map,
)

F, U, X = FREE, UNKNOWN, OCCUPIED
DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
MALFORMED, ROSMAPS = DATA / "malformed", DATA / "rosmaps"
ENTRIES = {
    "image": "map.pgm",
    "resolution": "0.05",
    "origin": "[-1.0, -2.0, 0.0]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}
GRID = OccupancyGrid(
    np.array([[F, X, U, F], [U, U, X, X], [F, F, F, X]]), 0.1 + 0.2, (-1 / 3, 1e-17, -0.35)
)


def write_yaml(folder: Path, name: str = "map.yaml", **changes: str | None) -> Path:
    lines = [f"{key}: {v}" for key, v in (ENTRIES | changes).items() if v is not None]
    file = folder / name
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def write_pgm(
    folder: Path, rows: list[list[int]], maxval: int = 255, name: str = "map.pgm"
) -> None:
    depth = ">u2" if maxval > 255 else "u1"
    head = f"P5\n{len(rows[0])} {len(rows)}\n{maxval}\n".encode()
    (folder / name).write_bytes(head + np.array(rows, depth).tobytes())


def load(folder: Path, pixels: list[list[int]], maxval: int = 255, **changes: str) -> list:
    write_pgm(folder, pixels, maxval)
    return load_map(write_yaml(folder, **changes)).cells.tolist()


def load_picture(folder: Path, picture: Image.Image, suffix: str = "png", **changes: str) -> list:
    picture.save(folder / f"map.{suffix}")
    return load_map(write_yaml(folder, image=f"map.{suffix}", **changes)).cells.tolist()


def picture(rows: list, kind: str = "u1") -> Image.Image:
    return Image.fromarray(np.array(rows, kind))


def refusal(file: Path) -> str:
    with pytest.raises(MapError) as caught:
        load_map(file)
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 500
    assert re.search(r": .+; .+", message)
    return message


# --- what a pixel means -----------------------------------------------------------------------


def test_load_map_reads_map_in_folder(tmp_path):
    """A folder with several maps is ambiguous."""
    grid = ascii_map("..#")
    save_map(grid, tmp_path / "hall.yaml")
    assert load_map(tmp_path) == grid
    save_map(grid, tmp_path / "lab.yaml")
    with pytest.raises(MapError, match="holds 2 maps; name one, such as "):
        load_map(tmp_path)
    (tmp_path / "a").mkdir()
    save_map(grid, tmp_path / "a" / "room.yaml")  # found first, in a folder of its own
    with pytest.raises(MapError, match=f"{tmp_path.name}: holds 3 maps"):
        load_map(tmp_path)


def test_top_image_row_has_highest_y(tmp_path):
    assert load(tmp_path, [[0, 254], [205, 254]]) == [[U, F], [X, F]]


def test_trinary_mode_includes_both_thresholds(tmp_path):
    # occupancy 1, .8, .6, .4, .2, 0
    pixels = [[0, 51, 102, 153, 204, 255]]
    changes = {"occupied_thresh": "0.8", "free_thresh": "0.2"}
    assert load(tmp_path, pixels, **changes) == [[X, X, U, U, F, F]]


def test_negate_makes_white_occupied(tmp_path):
    for negate in ("1", "true", "True"):
        assert load(tmp_path, [[0, 50, 255]], negate=negate) == [[F, U, X]]
    for negate in ("0", "false", None):
        assert load(tmp_path, [[0, 205, 255]], negate=negate) == [[X, U, F]]


def test_scale_mode_reads_intermediate_as_unknown(tmp_path):
    assert load(tmp_path, [[0, 100, 128, 200, 255]], mode="scale") == [[X, U, U, U, F]]


def test_raw_mode_ignores_negate(tmp_path):
    """The values are per cent."""
    for negate in ("0", "1"):
        cells = load(tmp_path, [[0, 19, 20, 64, 65, 100, 101, 255]], mode="raw", negate=negate)
        assert cells == [[F, F, U, U, X, X, U, U]]


def test_pgm_header_may_contain_many_blanks(tmp_path):
    """A regular expression that backtracks doubles the time with each blank, and never ends."""
    write_yaml(tmp_path)
    content = b"P5" + b" " * 200 + b"2 1 255\n" + bytes([0, 255])
    (tmp_path / "map.pgm").write_bytes(content)
    assert load_map(tmp_path / "map.yaml").cells.tolist() == [[X, F]]


def test_raw_mode_requires_8_bits(tmp_path):
    """Alpha is ignored."""
    assert load_picture(tmp_path, picture([[[0, 0], [100, 9]]]), mode="raw") == [[F, X]]
    write_pgm(tmp_path, [[0, 100]], 65535)
    assert "8 bits" in refusal(write_yaml(tmp_path, mode="raw"))
    write_pgm(tmp_path, [[0, 100]], 100)  # a reader would stretch 100 to 255
    assert "8 bits" in refusal(write_yaml(tmp_path, mode="raw"))


@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_less_than_opaque_is_unknown(tmp_path, mode):
    grey = picture([[[255, 255], [255, 254], [0, 0], [0, 255]]])
    assert load_picture(tmp_path, grey, mode=mode) == [[F, U, U, X]]
    colours = picture([[[255, 255, 255, 255], [255, 255, 255, 254], [0, 0, 0, 255]]])
    assert load_picture(tmp_path, colours, mode=mode) == [[F, U, X]]


def test_transparent_colour_is_unknown(tmp_path):
    for kind, clear, rest in (("u1", 7, 0), ("u2", 700, 0)):
        picture([[clear, rest]], kind).save(tmp_path / "map.png", transparency=clear)
        grid = load_map(write_yaml(tmp_path, image="map.png"))
        assert grid.cells.tolist() == [[U, X]]


def test_colour_is_read_as_luma(tmp_path):
    # luma 149, 29 and 76: occupancy .42, .89, .70
    colours = picture([[[0, 255, 0], [0, 0, 255], [255, 0, 0], [255, 255, 255]]])
    assert load_picture(tmp_path, colours) == [[U, X, X, F]]
    assert load_picture(tmp_path, colours, "bmp") == [[U, X, X, F]]


def test_palette_entries_are_looked_up(tmp_path):
    indexed = picture([[0, 1, 2]]).convert("P")
    indexed.putpalette([255, 255, 255, 0, 0, 0, 205, 205, 205])
    assert load_picture(tmp_path, indexed) == [[F, X, U]]
    indexed.save(tmp_path / "map.png", transparency=b"\x00\xff\xff")
    assert load_map(write_yaml(tmp_path, image="map.png")).cells.tolist() == [[U, X, U]]


def test_bilevel_image_has_no_unknown_cells(tmp_path):
    bits = picture([[0, 255, 255]]).convert("1")
    assert load_picture(tmp_path, bits) == [[X, F, F]]
    assert load_picture(tmp_path, bits, "pbm") == [[X, F, F]]
    (tmp_path / "map.pgm").write_text("P1\n3 1\n1 0 0\n")
    assert load_map(write_yaml(tmp_path)).cells.tolist() == [[X, F, F]]


def test_sixteen_bits_keep_their_precision(tmp_path):
    # The 8-bit values of the last two are the same.
    changes = {"occupied_thresh": "0.5001", "free_thresh": "0.5"}
    rows = [[0, 65535, 32764, 32740]]
    assert load(tmp_path, rows, 65535, **changes) == [[X, F, U, X]]
    assert load_picture(tmp_path, picture(rows, "u2"), **changes) == [[X, F, U, X]]


def test_maxval_is_rescaled(tmp_path):
    assert load(tmp_path, [[0, 80, 100]], 100) == [[X, U, F]]
    assert load(tmp_path, [[0, 800, 1000]], 1000) == [[X, U, F]]


def test_plain_pgm_may_hold_comments(tmp_path):
    (tmp_path / "map.pgm").write_text("P2 # x\n# a map\n3 1\n255\n0 205 # y\n254\n")
    assert load_map(write_yaml(tmp_path)).cells.tolist() == [[X, U, F]]


# --- the YAML and the paths -------------------------------------------------------------------


def test_yaml_sets_resolution_origin_and_name(tmp_path):
    write_pgm(tmp_path, [[254]])
    changes = {"resolution": "5e-2", "origin": '["1", -2.5, 1.57]'}
    grid = load_map(write_yaml(tmp_path, "hall 2.yaml", **changes))
    assert (grid.resolution, grid.origin, grid.name) == (0.05, (1.0, -2.5, 1.57), "hall 2")


def test_yaml_ignores_bom_and_unknown_keys(tmp_path):
    write_pgm(tmp_path, [[254]])
    file = write_yaml(tmp_path, type="[a, {b: c}]")
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert load_map(file).shape == (1, 1)


def test_image_path_accepts_home_and_unicode(tmp_path, monkeypatch):
    folder = tmp_path / "Größe 図"
    folder.mkdir()
    write_pgm(folder, [[254]], name="wöhn zimmer (1).pgm")
    monkeypatch.setenv("HOME", str(folder))
    for image in ("wöhn zimmer (1).pgm", folder / "wöhn zimmer (1).pgm", "~/wöhn zimmer (1).pgm"):
        assert load_map(write_yaml(folder, image=f'"{image}"')).shape == (1, 1)
    assert load_map(str(folder / "map.yaml")).shape == (1, 1)


# --- the warning ------------------------------------------------------------------------------


@pytest.mark.parametrize(("negate", "grey"), [("0", 205), ("1", 50)])
def test_load_map_warns_of_free_grey(tmp_path, negate, grey):
    write_pgm(tmp_path, [[grey, grey, 255, 0]])
    file = write_yaml(tmp_path, negate=negate, free_thresh="0.25")
    with pytest.warns(MapWarning, match=r"2 pixels \(50%\).*free_thresh: 0.196") as caught:
        load_map(file)
    assert caught[0].filename == __file__


def test_load_map_accepts_harmless_grey_silently(tmp_path):
    """Grey is harmless if it is rare, raw or read as unknown."""
    rare = [[205] + [254] * 99]
    assert load(tmp_path, rare, free_thresh="0.25") == [[F] * 100]
    assert load(tmp_path, [[205]], free_thresh="0.25", mode="raw") == [[U]]
    assert load(tmp_path, [[205]]) == [[U]]


# --- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "phrase"),
    [
        *(({key: None}, f"{key} .*missing") for key in ENTRIES if key != "negate"),
        ({"image": '""'}, "image must be the name"),
        ({"image": "[map.pgm]"}, "image must be the name"),
        ({"image": "!!python/name:os.system"}, "image must be the name"),
        ({"image": '"no\\nsuch.png"'}, r"image: there is no such file as 'no\\nsuch.png'"),
        *(({"image": v}, "image must be the name") for v in ('"a\\0b"', '"\\ud800"')),
        *(({"image": v}, "image must be the name .* missing") for v in ("~", "null", "")),
        ({"image": "x" * 5000}, "there is no such file as"),
        ({"image": "."}, "Is a directory"),
        *(({"resolution": v}, "resolution must be") for v in ("0", "-1", ".nan", ".inf", "true")),
        ({"resolution": "9" * 5000}, "resolution must be"),
        *(({"resolution": v}, "is it metres") for v in ("0.0009", "10.1", "50", "1e-8")),
        ({"resolution": "2024-99-99"}, "resolution must be"),
        *(({"origin": v}, "origin must be three") for v in ("123", "[0, 0]", "[0, 0, .inf]")),
        ({"origin": "[[0], 0, 0]"}, "origin must be three"),
        *(({"negate": v}, "negate must be 0 or 1") for v in ("2", "", "[0]")),
        ({"occupied_thresh": "65"}, "occupied_thresh .* not per cent"),
        ({"free_thresh": "19.6"}, "free_thresh .* not per cent"),
        ({"occupied_thresh": "true"}, "occupied_thresh must be"),
        ({"free_thresh": "-0.1"}, "free_thresh must be"),
        ({"free_thresh": "0.7"}, "free_thresh must be"),
        *(({"mode": v}, "mode must be trinary, scale or raw") for v in ("Raw", "[raw]")),
    ],
)
def test_bad_entries_are_refused_by_name(tmp_path, changes, phrase):
    write_pgm(tmp_path, [[254]])
    assert re.search(phrase, refusal(write_yaml(tmp_path, **changes)))


@pytest.mark.parametrize(
    ("content", "phrase"),
    [
        (b"", "is empty"),
        (b"# nothing\n", "no keys"),
        (b"- image: map.pgm\n", "no keys"),
        (b"image: a\nimage: b\n", "'image' occurs twice"),
        (b"image: a\n\tresolution: 1\n", "not YAML in UTF-8, see line 2"),
        (b"image: \xff\n", "not YAML in UTF-8"),
        (b"image: \0\n", "not YAML in UTF-8"),
        (b"a: " + b"[" * 20000, "brackets over 100 deep"),
        (b"a: b\n" * 2**16, "give a map YAML, which is a few lines"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "git lfs pull"),
    ],
)
def test_load_map_rejects_invalid_yaml(tmp_path, content, phrase):
    file = tmp_path / "map.yaml"
    file.write_bytes(content)
    message = refusal(file)
    assert message.startswith(f"{file}: ")
    assert phrase in message


def test_pixel_limit_halves_for_colour_images(tmp_path, monkeypatch):
    monkeypatch.setattr("locplan.maps.files.MAX_PIXELS", 100)
    for mode, size in (("L", (10, 10)), ("RGB", (10, 5))):
        Image.new(mode, size).save(tmp_path / "a.png")
        assert load_map(write_yaml(tmp_path, image="a.png")).shape == size[::-1]
        Image.new(mode, (11, size[1])).save(tmp_path / "a.png")
        assert "more pixels" in refusal(write_yaml(tmp_path, image="a.png"))


@pytest.mark.parametrize("mode", ["L", "P", "RGBA"])
def test_load_map_limits_memory_per_pixel(tmp_path, mode):
    image = Image.new("L", (512, 8192), 254)
    image.paste(100, (0, 0, 99, 99))
    image.convert(mode).save(tmp_path / "a.png", **({"transparency": 9} if mode == "P" else {}))
    file = write_yaml(tmp_path, image="a.png")
    load_map(file)  # what is imported takes memory, too
    tracemalloc.start()
    load_map(file)
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert taken < 6 * 512 * 8192


@pytest.mark.parametrize("name", ["map.pgm", "my map.png", "map.bmp"])
def test_load_map_suggests_yaml_for_image(tmp_path, name):
    Image.fromarray(np.full((20, 30), 254, np.uint8)).save(tmp_path / name)
    with pytest.raises(MapError, match="is an image, not a map's YAML; save these lines") as fault:
        load_map(tmp_path / name)
    (yaml,) = fault.value.__notes__
    assert len(yaml.splitlines()) == 6
    saved = (tmp_path / name).with_suffix(".yaml")
    saved.write_text(yaml)
    assert load_map(saved).shape == (20, 30)
    with pytest.raises(MapError, match=f"is an image, not a map's YAML; give {saved.name} next"):
        load_map(tmp_path / name)


@pytest.mark.parametrize("folder", ["/home/someone/maps/", "C:\\maps\\"])
def test_image_of_another_machine_is_named(tmp_path, folder):
    file = write_yaml(tmp_path, image=f"{folder}map.pgm")
    line = file.read_text().splitlines().index(f"image: {folder}map.pgm") + 1
    expected = f"{file}: line {line}, image: there is no such file as "
    assert refusal(file).startswith(expected)
    assert refusal(file).endswith("; put the image next to the YAML, and write its name there")
    write_pgm(tmp_path, [[254]])
    assert refusal(file).startswith(expected)
    assert refusal(file).endswith("; 'map.pgm' lies next to the YAML: write image: map.pgm")


@pytest.mark.parametrize("image", ["/home/someone/Hall.pgm", "hall.png"])
def test_image_of_similar_name_is_suggested(tmp_path, image):
    file = write_yaml(tmp_path, image=image)
    write_pgm(tmp_path, [[254]])
    (tmp_path / "map.pgm").rename(tmp_path / "hall.pgm")
    assert refusal(file).endswith("; 'hall.pgm' lies next to the YAML: write image: hall.pgm")


def test_missing_files_and_pipes_are_refused(tmp_path):
    assert "there is no such file; check its name" in refusal(tmp_path / "none.yaml")
    assert "is a folder without any map" in refusal(tmp_path)
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.pgm")
        assert "no plain file" in refusal(write_yaml(tmp_path, image="pipe.pgm"))


def png(width: int, height: int, data: bytes) -> bytes:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        )

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    parts = (b"IHDR", head), (b"IDAT", zlib.compress(data)), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)


@pytest.mark.parametrize(
    ("content", "phrase"),
    [
        (b"", "is empty"),
        (b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
        (b"GIF89a", "no intact"),
        (b"P5\n0 2\n255\n", "no intact"),
        (b"P5\n-1 2\n255\n11", "no intact"),
        (b"P5\n2 2\n255\n123", "truncated"),
        (b"P5\n2 2\n100\n123", "not enough"),
        (b"P5\n2 1\n70000\n1234", "maxval"),
        (b"P5\n200000 200000\n255\n1", "more pixels than"),
        (b"P5\n9000 9000\n255\n1", "more pixels than"),
        (b"P5\n12000 12000\n255\n1", "more pixels than"),
        (b"P2\n2 1\n255\n1", "not enough"),
        (b"P2\n2 1\n255\n1 256", "too large"),
        (b"P2\n2 1\n255\n1 -2", "negative"),
        (b"P2\n2 1\n255\n1 x", "no intact"),
        (b"Pf\n1 1\n-1.0\n1234", "pixels of type F"),
        (png(2, 1, b"\0ab")[:-20], "no intact"),
        (png(2, 1, b"\0ab").replace(b"IDATx", b"IDATy"), "broken PNG"),
    ],
)
def test_damaged_images_are_refused(tmp_path, content, phrase):
    (tmp_path / "map.pgm").write_bytes(content)
    message = refusal(write_yaml(tmp_path))
    assert message.startswith(f"{tmp_path / 'map.pgm'}: ")
    assert phrase in message


def test_image_content_overrides_suffix(tmp_path):
    (tmp_path / "map.pgm").write_bytes(png(2, 1, b"\0\x00\xff"))
    assert load_map(write_yaml(tmp_path)).cells.tolist() == [[X, F]]


def test_load_map_keeps_pillow_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 2)  # 3 pixels warn, 5 are an error
    assert load(tmp_path, [[0, 0, 255]]) == [[X, X, F]]
    assert load(tmp_path, [[255] * 5]) == [[F] * 5]
    assert Image.MAX_IMAGE_PIXELS == 2


@pytest.mark.parametrize("limit", [None, 2**40, 89478485])
def test_large_image_is_refused_before_decoding(tmp_path, monkeypatch, limit):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", limit)
    monkeypatch.setattr(ImageFile.ImageFile, "load", lambda _: pytest.fail("it is decoded"))
    monkeypatch.setattr(pixels, "PIXELS_PER_BYTE", 2**40)
    (tmp_path / "map.png").write_bytes(png(2**14 + 1, 2**14, b"\0"))
    assert "more pixels than" in refusal(write_yaml(tmp_path, image="map.png"))


# --- writing ----------------------------------------------------------------------------------

WAYS = [
    (mode, kind, negate)
    for mode in ("trinary", "raw", "scale")
    for kind in ("pgm", "png")
    for negate in (False, True)
    if (mode, kind) != ("scale", "pgm")
]


@pytest.mark.parametrize(("mode", "kind", "negate"), WAYS)
def test_loaded_map_equals_saved_map(tmp_path, mode, kind, negate):
    file = tmp_path / "Größe (1).yaml"
    save_map(GRID, file, mode=mode, image_format=kind, negate=negate)
    assert load_map(file).digest == GRID.digest
    assert load_map(file).name == "Größe (1)"
    assert {part.name for part in tmp_path.iterdir()} == {file.name, f"Größe (1).{kind}"}


@pytest.mark.parametrize("number", [0.001, 10.0, math.pi, 1 / 3, math.nextafter(1, 0)])
def test_numbers_are_written_exactly(tmp_path, number):
    grid = OccupancyGrid(np.array([[F]]), number, (number, -number, 0.1))
    save_map(grid, tmp_path / "map.yaml")
    assert load_map(tmp_path / "map.yaml").digest == grid.digest


def test_trinary_pixels_equal_map_saver(tmp_path):
    grid = OccupancyGrid(np.array([[F, U, X]]), 0.05)
    for negate, values in ((False, [254, 205, 0]), (True, [1, 50, 255])):
        save_map(grid, tmp_path / "map.yaml", negate=negate)
        assert list((tmp_path / "map.pgm").read_bytes()[-3:]) == values


@pytest.mark.parametrize(
    ("name", "options", "phrase"),
    [
        ("map.pgm", {}, "end it in .yaml"),
        ("map.yaml", {"mode": "scale"}, "needs transparency"),
        ("map.yaml", {"mode": "grey"}, "mode is unknown"),
        ("map.yaml", {"image_format": "bmp"}, "image_format is unknown"),
        ("none/map.yaml", {}, "writable folder"),
        ("file/map.yaml", {}, "writable folder"),
        ("taken.yaml", {}, "writable folder"),
    ],
)
def test_rejected_save_writes_no_file(tmp_path, name, options, phrase):
    (tmp_path / "file").write_text("")
    (tmp_path / "taken.yaml").mkdir()
    before = sorted(tmp_path.iterdir())
    with pytest.raises(MapError, match=phrase) as caught:
        save_map(GRID, tmp_path / name, **options)
    assert str(caught.value).isprintable()
    assert str(tmp_path / name) in str(caught.value)
    assert sorted(tmp_path.iterdir()) == before


def test_find_maps_skips_vanished_folder(tmp_path, monkeypatch):
    """Another process may remove its temporary folder during the search."""
    save_map(GRID, tmp_path / "room.yaml")
    (tmp_path / "temporary").mkdir()
    scan = os.scandir

    def scan_after_removal(folder):
        if Path(folder).name == "temporary":
            Path(folder).rmdir()
        return scan(folder)

    monkeypatch.setattr(os, "scandir", scan_after_removal)
    assert find_maps(tmp_path) == [tmp_path / "room.yaml"]


@respects_permissions
def test_save_map_rejects_unwritable_folder(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(MapError, match="Permission denied"):
        save_map(GRID, tmp_path / "map.yaml")


@pytest.mark.parametrize("existing", [True, False])
@pytest.mark.parametrize("step", ["write_text", "replace"])
def test_failed_save_keeps_old_files(tmp_path, monkeypatch, step, existing):
    file = tmp_path / "map.yaml"
    if existing:
        save_map(OccupancyGrid(np.array([[F, X]]), 0.05), file)
    before = {part.name: part.read_bytes() for part in tmp_path.iterdir()}

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(*((Path, step) if step == "write_text" else (os, step)), full)
    with pytest.raises(MapError, match="No space left"):
        save_map(GRID, file)
    assert {part.name: part.read_bytes() for part in tmp_path.iterdir()} == before


# --- collected files --------------------------------------------------------------------------


@pytest.fixture
def collected():
    if not (MALFORMED / "README.md").is_file():
        pytest.skip("the collected map files (shared/data) are not here")


def expectations() -> dict[str, str]:
    readme = MALFORMED / "README.md"
    text = readme.read_text(encoding="utf-8") if readme.is_file() else ""
    return dict(re.findall(r"^\| (\w+) \| ([a-z-]*(?:load|error)) \|", text, re.MULTILINE))


@pytest.mark.parametrize("case", [*expectations()] or ["absent"])
@pytest.mark.filterwarnings("ignore::locplan.maps.files.MapWarning")
def test_collected_inputs_behave_as_listed(collected, case):
    file, expected = MALFORMED / case / "map.yaml", expectations()[case]
    if expected == "clear-error":
        refusal(file)
    elif expected == "load":
        assert load_map(file).cells.size
    else:
        try:
            load_map(file)
        except MapError:
            refusal(file)


def test_collected_input_list_is_complete(collected):
    assert set(expectations()) == {d.name for d in MALFORMED.iterdir() if d.is_dir()}


def counts(cells: np.ndarray) -> tuple[int, int, int]:
    free, unknown, occupied = (int((cells == level).sum()) for level in (F, U, X))
    return free, unknown, occupied


OTHER_DRAWINGS = {
    "ok_mode_scale",
    "ok_1x1",
    "ok_all_unknown",
    "ok_all_occupied",
    "ok_png_1bit",
    "ok_thresh_equal",
}


def test_collected_encodings_give_same_cells(collected):
    plain = load_map(MALFORMED / "ok_plain" / "map.yaml").cells
    assert counts(plain) == (464, 32, 104)
    same = {case for case in expectations() if case.startswith("ok_")} - OTHER_DRAWINGS
    assert len(same) == 17
    for case in same:
        assert np.array_equal(load_map(MALFORMED / case / "map.yaml").cells, plain), case


def test_collected_drawings_give_expected_cells(collected):
    plain = load_map(MALFORMED / "ok_plain" / "map.yaml").cells
    without_unknown = np.where(plain == UNKNOWN, FREE, plain)
    two_levels = load_map(MALFORMED / "ok_png_1bit" / "map.yaml").cells
    assert np.array_equal(two_levels, without_unknown)
    with pytest.warns(MapWarning, match="32 pixels"):
        equal = load_map(MALFORMED / "ok_thresh_equal" / "map.yaml").cells
    assert np.array_equal(equal, without_unknown)
    # A ramp along x, alike in all rows: occupied to 89 (occupancy .651), free from 206 (.192).
    scale = MALFORMED / "ok_mode_scale"
    ramp = np.frombuffer((scale / "map.pgm").read_bytes()[-600:], np.uint8).reshape(20, 30)
    expected = np.where(ramp <= 89, X, np.where(ramp >= 206, F, U))
    assert np.array_equal(load_map(scale / "map.yaml").cells, expected[::-1])
    assert counts(expected) == (120, 260, 220)
    for case, expected_counts in (
        ("ok_1x1", (1, 0, 0)),
        ("ok_all_unknown", (0, 600, 0)),
        ("ok_all_occupied", (0, 0, 600)),
    ):
        assert counts(load_map(MALFORMED / case / "map.yaml").cells) == expected_counts


def test_real_maps_warn_of_free_grey(collected):
    files = sorted(ROSMAPS.glob("*/*.yaml"))
    assert len(files) >= 55
    for file in files:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            assert load_map(file).cells.size
        low = "free_thresh: 0.25" in file.read_text(encoding="utf-8")
        assert [w.category for w in caught] == [MapWarning] * low, file
