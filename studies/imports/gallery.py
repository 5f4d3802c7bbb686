"""A page to look at: every image small, with the points that were found drawn into it."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from calib.files.exports.images import opencv
from studies.document import Raw, Section
from studies.document.page import Writer, template
from studies.report.page import asset

if TYPE_CHECKING:
    from calib.files.exports.sightings import Sighting
    from studies.imports.record import ImportRecord

_WIDTH = 420  # px, of an image on the page
_QUALITY = 80  # per cent, of JPEG
_COLOURS = ((0, 158, 230), (180, 105, 0), (115, 158, 0))  # BGR, of boards: orange, blue, green
_CSS = """.shots{display:grid;grid-template-columns:repeat(auto-fill,minmax(15rem,1fr));gap:1rem}
.shots figure{margin:0}.shots img{width:100%;height:auto;display:block}
.shots .bad img{opacity:.55}.shots .bad figcaption{font-weight:600}"""


class Gallery:
    """Small images with what was found in them, in the order in which they are added."""

    def __init__(self) -> None:
        self.images: list[bytes] = []

    def add(self, own: Sighting, pixels: Any) -> None:
        """One image: crosses at the points, a colour for each board."""
        cv2 = opencv("--page")
        scale = _WIDTH / pixels.shape[1]
        small = cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        drawn = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)
        for k, (_, at) in enumerate(own.boards.values()):
            for u, v in np.rint(at * scale).astype(int).tolist():
                colour = _COLOURS[k % len(_COLOURS)]
                cv2.drawMarker(drawn, (u, v), colour, cv2.MARKER_CROSS, 9, 2, cv2.LINE_AA)
        _, data = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
        self.images.append(data.tobytes())

    def page(self, record: ImportRecord, seen: Mapping[str, Sequence[Sighting]]) -> str:
        """The page as HTML that names nothing outside itself."""
        from studies.kinds import tell

        writer, images = Writer.fresh(), iter(self.images)
        sections = [replace(own, key="summary") for own in tell(record).sections]
        for camera, every in seen.items():
            shown = Markup("\n").join(_figure(own, next(images)) for own in every)
            grid = Markup('<div class="shots">{}</div>').format(shown)
            title = f"Images of {camera}" if camera else "Images"
            sections.append(Section(f"images-{camera}", title, (Raw(grid),)))
        return template("studies.report", "page.html.j2").render(
            title="Imported images",
            told={"cell": record.cell},
            sections=[(own, writer.section(own, {})) for own in sections],
            styles=[asset("page.css"), Markup(_CSS)],  # noqa: S704
            scripts=[],
        )


def _figure(own: Sighting, image: bytes) -> Markup:
    said = ", ".join(f"{name} {len(ids)}" for name, (ids, _) in own.boards.items())
    text = f"{own.shot.pose}: {own.reason or said}"
    data = base64.b64encode(image).decode("ascii")
    return Markup(
        '<figure{}><img alt="{}" src="data:image/jpeg;base64,{}"><figcaption>{}</figcaption></figure>'
    ).format(Markup(' class="bad"' if own.reason else ""), text, data, text)  # noqa: S704
