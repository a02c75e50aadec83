"""A comparison for continuous integration: JUnit XML."""

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from processor.compare.comparison import Comparison
from processor.compare.gate import Checked
from processor.compare.judge import Judged
from processor.compare.report import points


def as_junit(comparison: Comparison, checked: Sequence[Checked] | None) -> str:
    """JUnit XML: a case a rule of the gate; without one, a case a measure."""
    if checked is None:
        cases = [_measure_case(one) for one in comparison.judged]
    else:
        cases = [_rule_case(one) for one in checked]
    counts = {kind: sum(case.find(kind) is not None for case in cases)
              for kind in ("failure", "skipped")}  # fmt: skip
    numbers = {"tests": str(len(cases)), "failures": str(counts["failure"]), "errors": "0",
               "skipped": str(counts["skipped"]), "time": "0"}  # fmt: skip
    suite = ET.Element("testsuite", {"name": "pomolog compare", **numbers})
    suite.extend(cases)
    ET.indent(suite)
    return ET.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"


def _rule_case(one: Checked) -> ET.Element:
    case = ET.Element("testcase", {"classname": "gate", "name": one.name, "time": "0"})
    if not one.passed:
        ET.SubElement(case, "failure", {"message": _plain(one.line), "type": one.rule.kind})
    elif one.unsure:
        ET.SubElement(case, "skipped", {"message": _plain(one.line)})
    return case


def _measure_case(one: Judged) -> ET.Element:
    about = {"classname": "compare", "name": one.measure.name, "time": "0"}
    case = ET.Element("testcase", about)
    line: str = one.verdict
    if one.difference is not None:
        line += f": {points(one.difference.change, one.measure, '+')}"
    if one.verdict == "worse":
        ET.SubElement(case, "failure", {"message": _plain(line), "type": "worse"})
    elif one.verdict in ("too little data", "not scored"):
        ET.SubElement(case, "skipped", {"message": _plain(line)})
    return case


def _plain(text: str) -> str:
    """Text that XML can hold: a file's name may have control characters."""
    return "".join(c if c.isprintable() else " " for c in text)
