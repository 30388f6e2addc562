"""Formats that are not read are named, each with what turns it into one that is."""

from __future__ import annotations

import re
from pathlib import Path

_HEAD_BYTES = 4096

_ULOG = ("a ULog of PX4", "ulog2csv (pyulog) writes a CSV of each topic: import that folder")
_BLF = ("a BLF of Vector's CANoe", "python-can and cantools decode it to CSV, or asammdf to MDF")
_BY_CONTENT: tuple[tuple[re.Pattern[bytes], str, str], ...] = (
    (re.compile(rb"ULog\x01\x12\x35"), *_ULOG),
    (
        re.compile(rb"\xa3\x95\x80"),
        "a log of ArduPilot",
        "mavlogdump.py --format csv --types IMU (pymavlink) writes CSV",
    ),
    (
        re.compile(rb"\s*(?:\[COM\d\]\s*)?(?:#[A-Z0-9]+A,[A-Z]+\d?\w*,\d+,[\d.]+,|%[A-Z0-9]+A,\d+,[\d.]+;)"),
        "a log of NovAtel in ASCII",
        "its samples are counts, whose scales the manual has for each IMU: NovAtel Convert or novatel-edie write CSV "
        "of each message, such as RAWIMUS and BESTPOS; "
        'with the scales as gyro_unit and accel_unit (such as "0.1 mdeg") in a mapping that imports',
    ),
    (re.compile(rb"\xaa\x44[\x12\x13\xb5]"), "a binary log of NovAtel", "novatel-edie or NovAtel Convert write CSV"),
    (
        re.compile(rb"\s*\$VN[A-Z]{3},"),
        "a log of VectorNav in ASCII",
        "its sentences have no times: record binary messages with TimeStartup, and export these as CSV; or name the "
        'columns of a CSV by a mapping with time = "row number"',
    ),
    (re.compile(rb"\xfa\xff"), "a binary log of Xsens (.mtb)", "MT Manager exports it as text (.txt)"),
    (
        re.compile(rb"# Created by Octave|# name: \w+\r?\n# type: "),
        "a text of variables of Octave",
        "save them in Octave as arrays of MATLAB: save -v7 FILE.mat",
    ),
    (re.compile(rb"LOGG"), *_BLF),
    (re.compile(rb"\d?\|?CF,\d,\d,"), "a file of imc FAMOS", "imc FAMOS exports it as MDF, TDMS or text"),
    (re.compile(rb"DIAEXTENDED|DIAdem"), "a header of DIAdem (.dat with .r64)", "DIAdem saves it as TDMS"),
    (
        re.compile(rb"\xd4\xc3\xb2\xa1|\xa1\xb2\xc3\xd4|\x0a\x0d\x0d\x0a"),
        "a capture of a network (pcap)",
        "export its decoded values as CSV",
    ),
    (
        re.compile(rb"\s*\(\d+\.\d+\)\s+\w+\s+[0-9A-Fa-f]+(#|\s+\[\d+\])[^:]*$", re.MULTILINE),
        "a log of raw CAN frames, of candump",
        "cantools decodes it by its DBC: cantools decode --single-line FILE.dbc < FILE.log > decoded.txt; import that",
    ),
    (
        re.compile(rb"date [^\n]*\r?\n\s*base (hex|dec)"),
        "a log of raw CAN frames, of Vector (.asc)",
        "python-can and cantools decode it to CSV, or asammdf to MDF",
    ),
    (
        re.compile(rb"(?=[^\n]*\bID\b)(?=[^\n]*\b(?:LEN|DLC)\b)[^\n]*\b(?:D1|Data|Data0|Byte0)\b", re.IGNORECASE),
        "a table of raw CAN frames",
        "cantools or SavvyCAN decode it by its DBC, to a CSV with a column for each signal",
    ),
    (
        re.compile(rb";\$FILEVERSION="),
        "a log of raw CAN frames, of PEAK (.trc)",
        "python-can and cantools decode it to CSV, or asammdf to MDF",
    ),
    (
        re.compile(rb"CDF\x05"),
        "a file of netCDF with 64 bit data (CDF-5)",
        "nccopy -k netCDF-4 OLD.nc NEW.nc (netcdf-bin) writes one that is read",
    ),
    (
        re.compile(rb"header:\s*\n\s+(seq|stamp):"),
        "a text of messages of ROS, of ros2 topic echo",
        "record a bag, ros2 bag record TOPIC ..., and import that; or echo Imu and NavSatFix with --csv",
    ),
    (
        re.compile(rb"SQLite format 3\x00"),
        "a SQLite database",
        "of a ROS 2 bag give the folder, which has metadata.yaml; give another one the suffix .db or .sqlite",
    ),
    (re.compile(rb"PAR1"), "a Parquet file", "give it the suffix .parquet"),
    (re.compile(rb"\x28\xb5\x2f\xfd"), "a file compressed by Zstandard", "unpack it: zstd -d"),
    (re.compile(rb"7z\xbc\xaf"), "a 7z archive", "unpack it, and import the folder"),
    (re.compile(rb"Rar!"), "a RAR archive", "unpack it, and import the folder"),
    (re.compile(rb"%PDF"), "a PDF", "take the table that it was made of"),
    (re.compile(rb".{8}\.FIT|.{8}fit", re.DOTALL), "a FIT file of a sports watch", "FitCSVTool writes CSV"),
    (
        re.compile(rb"\s*<\?xml.*<gpx\b|\s*<gpx\b", re.DOTALL),
        "a GPX track",
        "it has positions without an inertial sensor: give the folder in which it lies beside the table of one",
    ),
)
_BY_SUFFIX: dict[tuple[str, ...], tuple[str, str]] = {
    (".ods",): ("a spreadsheet of OpenDocument", "save it as .xlsx or .csv"),
    (".numbers",): ("a spreadsheet of Numbers", "export it as .xlsx or .csv"),
    (".xlsb",): ("a binary workbook", "save it as .xlsx or .csv"),
    (".pkl", ".pickle"): ("a pickle, which can run any code", "write it as Parquet: DataFrame.to_parquet"),
    (".rds", ".rdata"): ("a file of R", "write it as CSV: write.csv"),
    (".ulg",): _ULOG,
    (".dwd", ".dxd", ".d7d"): ("a file of Dewesoft", "Dewesoft X exports it as MDF, TDMS or text"),
    (".blf",): _BLF,
    (".rinex", ".obs"): (
        "a RINEX file",
        "it has raw observations: solve them, as with RTKLIB, and import the positions",
    ),
    (".bin", ".raw"): ("a binary file of unknown content", "export it as CSV with the logger's own tool"),
}


def unread_format(path: Path) -> str | None:
    """Return what a file is that is not read, and what to do with it; None where that is not known. Never raises."""
    if not path.is_file():
        return None
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEAD_BYTES)
    except OSError:
        return None
    by_content = [(name, hint) for pattern, name, hint in _BY_CONTENT if pattern.match(head)]
    by_suffix = [advice for suffixes, advice in _BY_SUFFIX.items() if path.suffix.casefold() in suffixes]
    for name, hint in (*by_content, *by_suffix):
        return f"{path}: is {name}, which is not read; expected a format that is. Hint: {hint}"
    return None
