from ._data import ReportData as ReportData
from ._data import Row as Row
from ._data import Scene as Scene
from ._report import write_report as write_report

__all__ = [
    "ReportData",
    "Row",
    "Scene",
    "write_report",
]
