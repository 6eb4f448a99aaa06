"""The code of python.md as one script, run in the folder of the clone."""

import logging

import numpy as np

import mocapclean

take = mocapclean.read("sample_data/walk.c3d")
print(take)  # <Take walk.c3d: 480 frames, 41 markers, 120 Hz, 1,000 samples missing>
seconds = len(take) / take.rate

ankle = take["LANK"]  # (F, 3), mm; NaN where the sample is missing
both = take[["LANK", "RANK"]]  # (F, 2, 3)
everything = take.to_numpy()  # (F, M, 3)

take = mocapclean.detect(take)
for finding in take.findings:
    if finding.frames and finding.rule != "missing":
        first, last = take.numbers(*finding.frames)
        print(f"{finding.marker}, frames {first} to {last}: {finding.message}")

result = mocapclean.fill(take)
print(result)  # <FillResult kriging: 1,000 filled, 0 left in 52 gaps (52 good), self-check ...>

bars = result.sd  # (F, M), mm: the expected standard deviation of a coordinate
is_filled = result.status == mocapclean.Status.FILLED  # (F, M)
worst = max(result.gaps, key=lambda gap: gap.expected or 0.0)
print(f"{worst.marker}: {worst.status.code}, {worst.grade}, {worst.expected} mm expected")

checked = result.self_check
if checked is not None and checked.total.error is not None:
    print(f"{checked.total.error.rmse_3d:.2f} mm on samples that were hidden")

curves = mocapclean.fill(take, "spline", max_gap=60, markers=["L*"])
print(curves.counts.left, curves.grades)

mocapclean.write(result.take, "walk_clean.c3d", overwrite=True)

dataset = result.to_xarray()
path = dataset["position"].sel(keypoint="LANK", individual="individual_0")
steps = np.linalg.norm(path.diff("time"), axis=1)

table = result.take.to_dataframe()  # a row for each frame, columns (marker, axis)
height = table["LANK"]["z"]

again = mocapclean.from_xarray(dataset)  # a take, which can be filled and written

logging.basicConfig(level=logging.INFO)  # event=read file=sample_data/walk.c3d format=c3d frames=480 ...
