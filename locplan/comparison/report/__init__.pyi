from ._data import ReportData as ReportData, Row as Row, Scene as Scene
from ._report import write_report as write_report
