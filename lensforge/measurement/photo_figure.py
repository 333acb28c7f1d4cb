"""The picture of a photo comparison: simulation and photograph side by side, and the lines through their centres."""

import io

from lensforge.measurement.comparison import PhotoComparison


def photo_png(found: PhotoComparison) -> bytes:
    """Both pictures on one scale, and their sections along x and y (mm), as a PNG file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    top, bottom = figure.subplots(2, 2)
    images = {"simulated": found.simulated, "measured": found.measured}
    half, most = found.receiver_mm / 2.0, max(float(image.max()) for image in images.values())
    for axes, (name, image) in zip(top, images.items(), strict=True):
        extent = (-half, half, -half, half)
        shown = axes.imshow(image, origin="lower", extent=extent, cmap="inferno", vmin=0.0, vmax=most)
        axes.set(title=name, xlabel="x (mm)", ylabel="y (mm)")
    figure.colorbar(shown, ax=top, label="irradiance (mean = 1)")
    sections = {
        "x": {"simulated": found.section_x_simulated, "measured": found.section_x_measured},
        "y": {"simulated": found.section_y_simulated, "measured": found.section_y_measured},
    }
    for axes, (axis, lines) in zip(bottom, sections.items(), strict=True):
        for (name, line), style in zip(lines.items(), ("-", "--"), strict=True):
            axes.plot(found.axis_mm, line, style, label=name)
        axes.set(xlabel=f"{axis} (mm)", ylabel="irradiance (mean = 1)", xlim=(-half, half))
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        axes.legend(frameon=False)
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=150)
    return png.getvalue()
