"""Texts of tables as each maker's program writes them, made of a small motion with a gap, for tests alone."""

import numpy as np

N_FRAMES, RATE = 40, 100.0
NAMES = ("LANK", "RANK", "LKNE", "RKNE", "STRN", "C7")
GAP = (slice(10, 15), 2)
"""Frames and column of the samples that are missing."""


def motion():
    """Positions (F, M, 3) in millimetres: markers of a body that turns and walks on; NaN in the gap."""
    time = np.arange(N_FRAMES)[:, None] / RATE
    base = np.array([[0, 90, 80], [0, -90, 80], [10, 100, 480], [10, -100, 480], [60, 5, 1250], [-70, 0, 1400]])
    angle = 0.3 * np.sin(2 * np.pi * time)
    x, y, z = base.T
    places = np.stack(
        [
            x * np.cos(angle) - y * np.sin(angle) + 1200 * time,
            x * np.sin(angle) + y * np.cos(angle),
            z + 20 * np.sin(4 * np.pi * time + x / 50),
        ],
        axis=2,
    )
    places += np.random.default_rng(1).normal(scale=0.2, size=places.shape)
    places[GAP] = np.nan
    return places


def spelled(places, form, missing):
    """The cells (F, M * 3) of positions; ``form``: of a number."""
    flat = places.reshape(len(places), -1)
    return [[form % value if np.isfinite(value) else missing for value in row] for row in flat.tolist()]


def trc(*, delimiter="\t", missing="", unit="mm", eol="\n", blank=True, first=1, n_frames=N_FRAMES, end=""):
    """A TRC file; ``end``: what follows the last cell of each row."""
    factor = {"mm": 1.0, "cm": 0.1, "m": 0.001}[unit]
    form = {"mm": "%.5f", "cm": "%.6f", "m": "%.7f"}[unit]
    lines = [
        delimiter.join(["PathFileType", "4", "(X/Y/Z)", "take.trc"]),
        delimiter.join(
            ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame"]
        ),
        delimiter.join(map(str, (f"{RATE:.2f}", f"{RATE:.2f}", n_frames, len(NAMES), unit, f"{RATE:.2f}", first))),
        delimiter.join(["Frame#", "Time", (delimiter * (1 if delimiter == " " else 3)).join(NAMES)]),
        delimiter * 2 + delimiter.join(f"{axis}{i + 1}" for i in range(len(NAMES)) for axis in "XYZ"),
        *([""] if blank else []),
    ]
    for i, row in enumerate(spelled(motion() * factor, form, missing)):
        lines.append(delimiter.join([str(first + i), f"{i / RATE:.3f}", *row]) + end)
    return eol.join([*lines, ""]).encode()


def motive(*, version="1.23", unit="Meters", labelled=True, eol="\r\n"):
    """A CSV file of Motive with a rigid body, its computed markers, measured markers and one without a label."""
    factor = {"Meters": 0.001, "Millimeters": 1.0}[unit]
    places = motion() * factor
    body = places[:, :2].mean(axis=1)
    columns = [
        ("Rigid Body", "Shank", "Rotation", "XYZW", np.tile([0.0, 0.0, 0.6, 0.8], (N_FRAMES, 1))),
        ("Rigid Body", "Shank", "Position", "XYZ", body),
        ("Rigid Body", "Shank", "Mean Marker Error", " ", np.full((N_FRAMES, 1), 0.0004)),
        ("Rigid Body Marker", "Shank:Marker1", "Position", "XYZ", places[:, 0] + 0.0001),
        ("Rigid Body Marker", "Shank:Marker1", "Marker Quality", " ", np.ones((N_FRAMES, 1))),
        *(("Marker", f"S:{name}", "Position", "XYZ", places[:, m]) for m, name in enumerate(NAMES)),
        ("Marker", "Unlabeled 1203", "Position", "XYZ", np.where(np.arange(N_FRAMES)[:, None] < 9, body, np.nan)),
    ]
    lead = ["", "Type", "Name", "ID", ""] if labelled else ["", "", "", "", ""]
    facts = (
        f"Format Version,{version},Take Name,Take 2024,Capture Frame Rate,{RATE:.6f},Export Frame Rate,{RATE:.6f},"
        f"Total Exported Frames,{N_FRAMES},Rotation Type,Quaternion,Length Units,{unit},Coordinate Space,Global"
    )

    def row(label, value):
        return ",".join(["", label, *(value(column) for column in columns for _ in column[3])])

    lines = [
        facts,
        "",
        row(lead[1], lambda c: c[0]),
        row(lead[2], lambda c: f'"{c[1]}"'),
        row(lead[3], lambda c: "1A2B"),
        row("", lambda c: c[2]),
        ",".join(["Frame", "Time (Seconds)", *(axis.strip() for column in columns for axis in column[3])]),
    ]
    numbers = spelled(np.concatenate([column[4] for column in columns], axis=1)[..., None], "%.6f", "")
    lines += [",".join([str(i), f"{i / RATE:.6f}", *cells]) for i, cells in enumerate(numbers)]
    return eol.join([*lines, ""]).encode()


def nexus(*, first=251, eol="\r\n", others=True):
    """A CSV file of Nexus: events, devices, model outputs, and the trajectories of a subject; six digits a number."""
    before = [
        "Events",
        f"{RATE:.0f}",
        "Subject,Context,Name,Time (s),Description",
        "Ann,Left,Foot Strike,2.6,The instant the heel strikes the ground",
        "Ann,Right,Foot Off,2.55,The instant the toe leaves the ground",
        "",
        "Devices",
        "1000",
        ",,Force Plate - Force,,",
        "Frame,Sub Frame,Fx,Fy,Fz",
        ",,N,N,N",
        *(f"{first + i // 10},{i % 10},0.1,0.2,{i}" for i in range(30)),
        "",
        "Model Outputs",
        f"{RATE:.0f}",
        ",,Ann:LKneeAngles,,",
        "Frame,Sub Frame,X,Y,Z",
        ",,deg,deg,deg",
        *(f"{first + i},0,{i}.5,2,3" for i in range(N_FRAMES)),
        "",
    ]
    lines = [
        *(before if others else []),
        "Trajectories",
        f"{RATE:.0f}",
        ",," + ",,,".join([*(f"Ann:{name}" for name in NAMES), "*12"]) + ",,",
        "Frame,Sub Frame" + ",X,Y,Z" * (len(NAMES) + 1),
        "," + ",mm" * 3 * (len(NAMES) + 1),
        *(",".join([str(first + i), "0", *row, "", "", ""]) for i, row in enumerate(spelled(motion(), "%.6g", ""))),
        "",
    ]
    return eol.join([*lines, ""]).encode()


def qualisys(*, header=True, titles=True, lead=2, missing="0.000", eol="\r\n", first=1):
    """A TSV file of Qualisys with or without header, titles, and the frame's number and time."""
    facts = [
        f"NO_OF_FRAMES\t{N_FRAMES}",
        "NO_OF_CAMERAS\t10",
        f"NO_OF_MARKERS\t{len(NAMES)}",
        f"FREQUENCY\t{RATE:.0f}",
        "NO_OF_ANALOG\t0",
        "ANALOG_FREQUENCY\t0",
        "DESCRIPTION\t--",
        "TIME_STAMP\t2024-03-05, 10:11:12.345\t12345.67890123",
        "DATA_INCLUDED\t3D",
        f"EVENT\tJump\t{first + 12}\t0.12000",
        "MARKER_NAMES\t" + "\t".join(NAMES),
        "TRAJECTORY_TYPES\t" + "\t".join(["Measured"] * len(NAMES)),
    ]
    named = ["Frame", "Time"][:lead] + [f"{name} {axis}" for name in NAMES for axis in "XYZ"]
    rows = [
        "\t".join([*[str(first + i), f"{i / RATE:.5f}"][:lead], *row])
        for i, row in enumerate(spelled(motion(), "%.3f", missing))
    ]
    return eol.join([*(facts if header else []), *(["\t".join(named) + "\t"] if titles else []), *rows, ""]).encode()


def plain(*, pattern="{name}_{axis}", axes="XYZ", delimiter=",", comma=False, lead=("frame", "time"), eol="\n"):
    """A plain table with named columns, a confidence of each marker, and a time in seconds."""
    values = {
        "frame": lambda i: str(i),
        "time": lambda i: f"{i / RATE:.4f}",
        "time_ms": lambda i: f"{i * 1e3 / RATE:.1f}",
    }
    titles = [pattern.format(name=name, axis=axis) for name in NAMES for axis in axes]
    lines = [delimiter.join([*lead, *titles, *(f"{name}_score" for name in NAMES)])]
    for i, row in enumerate(spelled(motion(), "%.4f", "")):
        cells = [*(values[name](i) for name in lead), *row, *["0.95"] * len(NAMES)]
        if comma:
            cells = [cell.replace(".", ",") for cell in cells]
        lines.append(delimiter.join(cells))
    return eol.join([*lines, ""]).encode()


TEXTS = {
    "trc.trc": trc(),
    "trc_crlf_nan_m.trc": trc(eol="\r\n", missing="NaN", unit="m", first=258, end="\t"),
    "trc_space.trc": trc(delimiter=" ", missing="nan", unit="cm"),
    "trc_comma.trc": trc(delimiter=",", blank=False),
    "motive.csv": motive(),
    "motive_old.csv": motive(version="1.21", unit="Millimeters", labelled=False),
    "nexus.csv": nexus(),
    "nexus_alone.csv": nexus(others=False, first=1, eol="\n"),
    "qualisys.tsv": qualisys(),
    "qualisys_plain.tsv": qualisys(titles=False, lead=0),
    "qualisys_null.tsv": qualisys(missing="NULL", lead=1, eol="\n"),
    "plain.csv": plain(),
    "plain_semicolon.csv": plain(delimiter=";", comma=True, pattern="{axis}_{name}", axes="xyz"),
    "plain_tab.tsv": plain(delimiter="\t", pattern="{name}.{axis} [mm]", lead=("time_ms",)),
    "plain_bom.csv": b"\xef\xbb\xbf" + plain(eol="\r\n", pattern="{name}:{axis}"),
    "plain_wide.csv": plain(delimiter="\t").decode().encode("utf-16"),
}
"""A text of each kind by a file name of it."""
