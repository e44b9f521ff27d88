"""The page within a notebook: a frame of HTML."""

from __future__ import annotations

import sys
from html import escape

HEIGHT = 720
"""Height of the frame [px]."""


def in_notebook() -> bool:
    """Whether the program runs in a notebook's kernel, which shows HTML."""
    module = sys.modules.get("IPython")
    shell = module.get_ipython() if module is not None else None
    return getattr(shell, "kernel", None) is not None


def frame_html(address: str, height: int = HEIGHT) -> str:
    """HTML of a frame that shows a page of this machine, with a link to it below.

    The frame stays empty where the notebook's browser runs on another machine, or where the
    notebook forbids frames.

    Examples
    --------
    >>> frame_html("http://127.0.0.1:8000/secret/", 400).count("http://127.0.0.1:8000/secret/")
    2
    """
    link = escape(address, quote=True)
    return (
        f'<iframe src="{link}" title="locplan explorer" width="100%" height="{height:d}"'
        ' style="border: 0" allow="clipboard-write; fullscreen"></iframe>'
        f'<a href="{link}" target="_blank" rel="noopener">Open in a tab of its own</a>'
    )
