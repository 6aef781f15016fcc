//! `light_source { ... }`.

use super::lexer::{Parsed, Position, fault};
use super::parser::Parser;
use crate::scene::{PunctualEmission, PunctualLight};
use glam::DVec3;

/// What the modifiers of a light source add up to.
#[derive(Debug, Default)]
struct Modifiers {
    area_illumination: bool,
    fade_distance: f64,
    fade_power: f64,
    area: Option<[DVec3; 2]>,
}

impl Parser {
    /// The light source whose keyword comes next.
    pub fn light_source(&mut self) -> Parsed<PunctualLight<DVec3>> {
        let (_, at) = self.next()?;
        let mut light: Option<PunctualLight<DVec3>> = None;
        let mut modifiers = Modifiers::default();
        self.block("light_source", at, |p| match &mut light {
            None => p.bare_light().map(|l| light = Some(l)),
            Some(light) => p.light_modifier(light, &mut modifiers),
        })?;
        let Some(mut light) = light else { return fault(at, "`light_source` is empty") };
        // A distance without a power does not fade, as in POV-Ray.
        let fades = modifiers.fade_distance > 0.0 && modifiers.fade_power > 0.0;
        if let PunctualEmission::Pov { fade, .. } = &mut light.emission {
            *fade = fades.then_some((modifiers.fade_distance, modifiers.fade_power));
        }
        light.area = light.area.or(modifiers.area);
        light.area_illumination = modifiers.area_illumination;
        Ok(light)
    }

    /// Position and colour.
    fn bare_light(&mut self) -> Parsed<PunctualLight<DVec3>> {
        let position = self.vector()?;
        self.comma()?;
        let at = self.position()?;
        let colour = self.colour()?;
        if colour.min_element() < 0.0 {
            return fault(at, "a light's colour cannot be negative");
        }
        let emission = PunctualEmission::Pov { colour: colour.as_vec3(), fade: None };
        Ok(PunctualLight { position, emission, area: None, area_illumination: false })
    }

    fn light_modifier(&mut self, light: &mut PunctualLight<DVec3>, modifiers: &mut Modifiers) -> Parsed<()> {
        if let Some(transform) = self.transform()? {
            light.position = transform.transform_point3(light.position);
            modifiers.area = modifiers.area.map(|edges| edges.map(|e| transform.transform_vector3(e)));
            return Ok(());
        }
        let at = self.position()?;
        let word = self.peek_word()?.unwrap_or_default();
        if self.light_property(&word, at, modifiers)? {
            Ok(())
        } else {
            self.unexpected("a property of the light source")
        }
    }

    fn light_property(&mut self, word: &str, at: Position, modifiers: &mut Modifiers) -> Parsed<bool> {
        match word {
            "fade_distance" => modifiers.fade_distance = self.fade()?,
            "fade_power" => modifiers.fade_power = self.fade()?,
            "area_light" => modifiers.area = self.area()?,
            "adaptive" => self.next().and_then(|_| self.scalar()).map(|_| ())?,
            "jitter" => self.next().map(|_| ())?,
            "area_illumination" => {
                self.next()?;
                modifiers.area_illumination = self.scalar()? != 0.0;
            }
            "media_attenuation" | "media_interaction" => {
                self.next()?;
                self.scalar()?;
            }
            "circular" | "orient" | "shadowless" => {
                self.next()?;
                self.warn(at, format!("light_source: `{word}` is not supported and ignored"));
            }
            "looks_like" | "projected_through" => {
                self.next()?;
                self.warn(at, format!("light_source: `{word}` is not supported and ignored"));
                self.skip_block("looks_like", at)?;
            }
            "spotlight" | "cylinder" | "parallel" | "point_at" => {
                return fault(
                    at,
                    format!("light_source: `{word}` is not supported; point and area lights are"),
                );
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn fade(&mut self) -> Parsed<f64> {
        self.next()?;
        let at = self.position()?;
        match self.scalar()? {
            value if value >= 0.0 => Ok(value),
            value => fault(at, format!("a light's fading cannot be negative: {value}")),
        }
    }

    /// `area_light edge, edge, columns, rows`: the grid only says how well POV-Ray samples the light, except that one
    /// row and column make a point.
    fn area(&mut self) -> Parsed<Option<[DVec3; 2]>> {
        self.next()?;
        let first = self.vector()?;
        self.comma()?;
        let second = self.vector()?;
        self.comma()?;
        let columns = self.count()?;
        self.comma()?;
        let rows = self.count()?;
        let spread = |edge: DVec3, samples: usize| if samples > 1 { edge } else { DVec3::ZERO };
        let edges = [spread(first, columns), spread(second, rows)];
        Ok(edges.iter().any(|e| *e != DVec3::ZERO).then_some(edges))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::parse;
    use super::*;

    fn light(text: &str) -> PunctualLight<DVec3> {
        parse(&format!("light_source {{ {text} }} sphere {{ 0, 1 }}")).unwrap().lights.remove(0)
    }

    #[test]
    fn lights_fade_only_with_a_distance_and_a_power() {
        let fade = |text: &str| match light(text).emission {
            PunctualEmission::Pov { fade, .. } => fade,
            other => panic!("{other:?}"),
        };
        assert_eq!(fade("0 rgb 1"), None);
        assert_eq!(fade("0 rgb 1 fade_distance 3"), None);
        assert_eq!(fade("0, color rgb 1 fade_power 2 fade_distance 3"), Some((3.0, 2.0)));
    }

    #[test]
    fn transforms_turn_the_edges_of_an_area_light() {
        let light = light(
            "<0,9,0> rgb <1,2,3> area_light <2,0,0>, <0,0,3>, 4, 4 adaptive 1 jitter translate x rotate y*90",
        );
        let [a, b] = light.area.unwrap();
        assert!((light.position - DVec3::new(0.0, 9.0, -1.0)).length() < 1e-12);
        assert!((a - DVec3::NEG_Z * 2.0).length() < 1e-12 && (b - DVec3::X * 3.0).length() < 1e-12);
    }
}
