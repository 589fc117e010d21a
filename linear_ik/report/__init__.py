"""Report: one HTML file that an engineer reads, files and signs; it needs no network and no server."""

from linear_ik.report.members import ReportedMember, Run, judged_member, read_run
from linear_ik.report.page import Nearby, check_sections, nearby, render, write_report

__all__ = [
    "Nearby",
    "ReportedMember",
    "Run",
    "check_sections",
    "judged_member",
    "nearby",
    "read_run",
    "render",
    "write_report",
]
