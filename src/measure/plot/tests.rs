//! Charts as files.

use super::*;

fn sample() -> Plot {
    let point = |x: f64, y: f64, label: &str| Point { x, y, error: 0.1 * y, label: label.into() };
    let cloud = (0..60).map(|i| {
        let t = f64::from(i) / 60.0;
        point(
            0.2 * 20f64.powf(t),
            0.06 * 0.05f64.powf(t) * (1.0 + 0.6 * (f64::from(i) * 2.4).sin().abs()),
            "",
        )
    });
    let series =
        |name: &str, colour, line, marker, points| Series { name: name.into(), colour, line, marker, points };
    let named = vec![
        point(0.25, 0.05, "draft"),
        point(0.5, 0.02, "preview"),
        point(0.55, 0.018, "final"),
        point(3.0, 0.004, "reference"),
    ];
    Plot {
        title: "Error over time: a < b & c".into(),
        subtitle: "500 x 500 pixels, two cores".into(),
        x: Axis::new("seconds", Scale::Log, Format::Plain),
        y: Axis::new("relative RMS error", Scale::Log, Format::Percent),
        series: vec![
            series("settings", Colour::Palette(0), Line::None, Marker::Speck, cloud.collect()),
            series(
                "Pareto front",
                Colour::Palette(0),
                Line::Solid,
                Marker::None,
                vec![point(0.2, 0.06, ""), point(4.0, 0.003, "")],
            ),
            series("named qualities", Colour::Palette(1), Line::None, Marker::Ring, named),
        ],
    }
}

#[test]
fn svg_is_well_formed_and_says_everything() {
    let svg = sample().to_svg();
    for words in [
        "Error over time: a &lt; b &amp; c",
        ">draft<",
        ">Pareto front<",
        ">seconds<",
        "prefers-color-scheme",
    ] {
        assert!(svg.contains(words), "{words}");
    }
    let (opened, closed) = (svg.matches("<text").count(), svg.matches("</text>").count());
    assert!(opened == closed && svg.ends_with("</svg>\n"));
    assert!(!svg.contains("NaN") && !svg.contains("inf\""));
}

#[test]
fn png_has_the_size_of_the_sheet_twice_and_is_painted() {
    let picture = image::load_from_memory(&sample().to_png()).unwrap().to_rgb8();
    assert_eq!(picture.dimensions(), (1920, 1200));
    let dark = picture.pixels().filter(|p| p.0.iter().all(|&v| v < 90)).count();
    let blue = picture.pixels().filter(|p| p.0 == [0x1f, 0x6f, 0xd6]).count();
    assert!(dark > 2000 && blue > 500, "{dark} dark pixels, {blue} blue ones");
}

#[test]
fn what_cannot_be_placed_is_left_out() {
    let mut plot = sample();
    for series in &mut plot.series {
        series.points.push(Point { x: 0.0, y: f64::NAN, ..Point::default() });
        series.points.push(Point { x: 1.0, y: -1.0, label: "below".into(), ..Point::default() });
    }
    let svg = plot.to_svg();
    assert!(!svg.contains("NaN") && !svg.contains(">below<"));
    plot.series.clear();
    assert!(plot.to_svg().contains("seconds"), "axes alone");
}

#[test]
fn formats_are_named_by_extensions() {
    assert_eq!(PlotFormat::from_path(Path::new("a.SVG")).unwrap(), PlotFormat::Svg);
    assert_eq!(PlotFormat::from_path(Path::new("a.png")).unwrap(), PlotFormat::Png);
    for path in ["a.pdf", "a"] {
        let error = PlotFormat::from_path(Path::new(path)).unwrap_err();
        assert!(error.exit_code() == 2 && error.to_string().contains(".svg"), "{error}");
    }
}

#[test]
fn files_appear_whole() {
    let folder = tempfile::tempdir().unwrap();
    for (name, format) in [("a.svg", PlotFormat::Svg), ("a.png", PlotFormat::Png)] {
        let path = folder.path().join(name);
        sample().write(&path, format).unwrap();
        assert!(path.metadata().unwrap().len() > 5000);
    }
}
