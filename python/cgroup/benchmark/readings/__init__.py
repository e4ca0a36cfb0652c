"""The paper's open questions, read in other ways, one at a time and together."""

from cgroup.benchmark.readings.expansion import add_readings
from cgroup.benchmark.readings.files import write_readings
from cgroup.benchmark.readings.outcomes import ReadingOutcome, judge_readings
from cgroup.benchmark.readings.questions import Question, list_readings, read_questions
from cgroup.benchmark.readings.reading import Reading

__all__ = [
    "Question",
    "Reading",
    "ReadingOutcome",
    "add_readings",
    "judge_readings",
    "list_readings",
    "read_questions",
    "write_readings",
]
