"""The codecs: pure functions between bytes and frames, one file a kind of device.

None of them is, or claims to be, the wire format of PPS DigiTacts, which is not public.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from tactsim.hardware.codecs.fields import FieldsFormat
from tactsim.hardware.codecs.pps_csv import CsvFormat
from tactsim.hardware.codecs.singletact import SingleTactFormat

Format = Annotated[FieldsFormat | SingleTactFormat | CsvFormat, Field(discriminator="kind")]
KINDS = {
    "singletact": "SingleTact sensors and arrays behind the maker's Arduino bridge",
    "fields": "frames of a layout that the device file describes",
    "pps-csv": "lines 'Time [ms], Elem0, ...' as the PPS demonstration tool records them",
}

__all__ = ["KINDS", "Format"]
