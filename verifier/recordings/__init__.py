"""Recordings in and out: MCAP, and the tables it can be made from."""

from verifier.recordings.choice import Choice
from verifier.recordings.copying import copy_with_verdicts
from verifier.recordings.errors import OutputExistsError, RecordingError
from verifier.recordings.import_summary import ImportSummary
from verifier.recordings.importing import ImportSettings, import_recording
from verifier.recordings.inspection import Inspection, inspect_recording
from verifier.recordings.people_source import PeopleFile, Place
from verifier.recordings.reading import Reading
from verifier.recordings.recording import Recording
from verifier.recordings.recording_writer import RecordingWriter, new_recording
from verifier.recordings.window import Window
from verifier.recordings.writing import check_new_file, new_file

__all__ = [
    "Choice",
    "ImportSettings",
    "ImportSummary",
    "Inspection",
    "OutputExistsError",
    "PeopleFile",
    "Place",
    "Reading",
    "Recording",
    "RecordingError",
    "RecordingWriter",
    "Window",
    "check_new_file",
    "copy_with_verdicts",
    "import_recording",
    "inspect_recording",
    "new_file",
    "new_recording",
]
