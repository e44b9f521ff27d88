"""Arrays in .npz files: the only reader, and the only writer."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from locplan._support.reading import open_plain_file


def read_arrays(
    file: str | os.PathLike[str], limit: float, names: Collection[str] | None = None
) -> dict[str, NDArray[Any]]:
    """Read arrays of a .npz file by name: all, or the existing ones of `names`.

    Nothing in the file is executed. The arrays are read-only.

    Parameters
    ----------
    file : path
        The file.
    limit : float
        Maximum size of these arrays together, unpacked [bytes].
    names : collection of str, optional
        Names of the arrays.

    Raises
    ------
    OSError
        If the file cannot be read, or the arrays are too large.
    ValueError
        If the file is damaged, or no .npz file.
    """
    import zipfile

    with open_plain_file(file) as content:
        try:
            with zipfile.ZipFile(content) as archive:
                members = {
                    member.filename.removesuffix(".npy"): member for member in archive.infolist()
                }
                selected_names = [name for name in members if names is None or name in names]
                if (total := sum(members[name].file_size for name in selected_names)) > limit:
                    size_limit = f"of at most {limit / 1e6:.0f} MB"
                    raise OSError(f"its arrays take {total / 1e6:.0f} MB, {size_limit}")
                return {name: _read_array(archive.read(members[name])) for name in selected_names}
        except OSError:
            raise
        except Exception as error:  # a damaged archive fails in as many ways as it has parts
            raise ValueError(str(error)[:200] or type(error).__name__) from None


def _read_array(data: bytes) -> NDArray[Any]:
    """Return the array of a .npy file, without a copy of its values."""
    from io import BytesIO

    content = BytesIO(data)
    if np.lib.format.read_magic(content) == (1, 0):
        shape, fortran_order, dtype = np.lib.format.read_array_header_1_0(content)
        size = math.prod(shape)
        if not dtype.hasobject and size * dtype.itemsize == len(data) - content.tell():
            if not size:
                return np.empty(shape, dtype)
            values = np.frombuffer(data, dtype, size, content.tell())
            return values.reshape(shape, order="F" if fortran_order else "C")
    content.seek(0)
    array: NDArray[Any] = np.lib.format.read_array(content, allow_pickle=False)
    return array


def write_arrays(
    file: str | os.PathLike[str],
    arrays: Mapping[str, ArrayLike],
    *,
    uncompressed_names: Collection[str] = (),
) -> None:
    """Write arrays by name into a .npz file.

    Parameters
    ----------
    file : path
        The file; an existing file is replaced.
    arrays : mapping of str to array
        The arrays.
    uncompressed_names : collection of str, optional
        Names of the arrays that are not compressed, and read five times as fast.
    """
    import zipfile

    # Level 1 takes a third of the usual level's time, and a tenth more room.
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            archive.compression = (
                zipfile.ZIP_STORED if name in uncompressed_names else zipfile.ZIP_DEFLATED
            )
            with archive.open(f"{name}.npy", "w", force_zip64=True) as target:
                np.lib.format.write_array(target, np.asarray(array), allow_pickle=False)
