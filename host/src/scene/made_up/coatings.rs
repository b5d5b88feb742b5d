//! Random colours, textures and finishes.

use super::dice::Dice;
use crate::scene::{
    object::{Finish, Object},
    pose::Pose,
    shape::Shape,
    texture::{Motif, Placement, Texture},
    vec3::Vec3,
};

/// What objects of one scene look like.
pub struct Coatings {
    /// The share of objects that are blank.
    blank: f64,
    /// The share of objects that look alike, and how they look.
    alike: f64,
    common: Coating,
    /// The share of objects whose finish reflects.
    glossy: f64,
}

/// What one object looks like.
#[derive(Clone, Copy)]
pub struct Coating {
    texture: Texture,
    finish: Finish,
    /// The size of a unit of the texture in pixels.
    zoom: f64,
    /// Where the texture begins.
    pose: Pose,
}

impl Coatings {
    pub fn new(dice: &mut Dice) -> Coatings {
        let (blank, glossy) = (dice.pick([0.05, 0.15, 0.35, 0.7]), dice.pick([0.0, 0.2, 0.5]));
        let common = coating(dice, blank, glossy, true);
        Coatings { blank, alike: dice.pick([0.0, 0.0, 0.0, 0.6]), common, glossy }
    }

    /// The look of the next object. Textures that have two dimensions are for panels, which are `flat`.
    pub fn next(&self, dice: &mut Dice, flat: bool) -> Coating {
        if dice.happens(self.alike) { self.common } else { coating(dice, self.blank, self.glossy, flat) }
    }
}

impl Coating {
    /// An object that looks so. A pixel shows `footprint` millimetres of it.
    pub fn object(&self, shape: Shape, pose: Pose, footprint: f64) -> Object {
        let finish = match (self.finish, shape) {
            // Brush strokes run along panels.
            (Finish::Brushed, Shape::Panel { .. }) => Finish::Brushed,
            (Finish::Brushed, _) => Finish::Satin,
            (finish, _) => finish,
        };
        let placement = Placement { pose: self.pose, scale: self.zoom * footprint };
        Object { shape, pose, texture: self.texture, placement, finish }
    }

    /// The same look, of which another part is seen.
    pub fn moved(&self, dice: &mut Dice) -> Coating {
        Coating { pose: self.pose.moved([dice.between(-500.0, 500.0), dice.between(-500.0, 500.0), 0.0]), ..*self }
    }
}

fn coating(dice: &mut Dice, blank: f64, glossy: f64, flat: bool) -> Coating {
    let colors = Colors::new(dice);
    let texture = if dice.happens(blank) { blank_texture(dice, &colors) } else { texture(dice, &colors, flat) };
    let finish = match texture {
        Texture::Brushed(_) => Finish::Brushed,
        _ if dice.happens(glossy) => dice.pick([Finish::Satin, Finish::Glazed, Finish::Glazed]),
        _ => Finish::Matte,
    };
    let origin = [0; 3].map(|_| dice.between(-500.0, 500.0));
    let spread = Pose::at(Vec3::ZERO).moved(origin);
    let pose = if flat { spread.turned(2, dice.between(-1.0, 1.0)) } else { dice.turned(spread) };
    Coating { texture, finish, zoom: dice.mostly_low(1.0, 5.0), pose }
}

/// A texture with nothing on it, or nearly.
fn blank_texture(dice: &mut Dice, colors: &Colors) -> Texture {
    if dice.happens(0.4) {
        return Texture::Plain(colors.base);
    }
    let contrast = dice.mostly_low(0.005, 0.08);
    let [low, high] = [1.0 - contrast, 1.0 + contrast].map(|factor| colors.base * factor);
    Texture::Clouds { low, high, grain: dice.mostly_low(1.0, 12.0), octaves: dice.count(2, 4) as u8 }
}

fn texture(dice: &mut Dice, colors: &Colors, flat: bool) -> Texture {
    let [base, other] = [colors.base, colors.others[0]];
    let octaves = dice.count(2, 5) as u8;
    match dice.count(0, 15) {
        0..=3 => Texture::Clouds { low: base, high: other, grain: dice.mostly_low(1.0, 3.0), octaves },
        4 if flat => Texture::Plaster { low: base, high: other, grain: dice.mostly_low(1.0, 3.0), octaves },
        4 => Texture::Clouds { low: base, high: other, grain: 1.2, octaves: 4 },
        5 => Texture::Wood { light: base, dark: other, ring: dice.between(4.0, 14.0) },
        6 => Texture::Marble { base, vein: other, size: dice.between(25.0, 90.0) },
        7 => Texture::Checker { even: base, odd: other, side: dice.mostly_low(3.0, 20.0) },
        8 => Texture::Terrazzo { cement: base, chips: colors.others, pitch: dice.mostly_low(5.0, 20.0) },
        9 => Texture::Dots { paper: base, inks: colors.others, pitch: dice.mostly_low(5.0, 25.0) },
        10 => Texture::Cloth { ground: base, stripe: other, pitch: dice.mostly_low(4.0, 40.0) },
        11 if flat => Texture::Brushed(base),
        14 | 15 => {
            let [a, b, c] = [0, 1, 2].map(|k| colors.others[k]);
            Texture::Poster { inks: [base, a, b, c], size: dice.mostly_low(8.0, 70.0) }
        }
        _ => Texture::Repeated {
            motif: dice.pick(Motif::ALL),
            colors: [base, other],
            pitch: dice.mostly_low(3.0, 20.0),
            clouds: if dice.happens(0.5) { 0.0 } else { dice.mostly_low(0.02, 0.8) },
        },
    }
}

/// The colours of a texture, in linear light.
struct Colors {
    base: Vec3,
    others: [Vec3; 4],
}

impl Colors {
    fn new(dice: &mut Dice) -> Colors {
        let base = color(dice);
        if dice.happens(0.45) {
            return Colors { base, others: [(); 4].map(|()| color(dice)) };
        }
        // Similar colours: little contrast, as most surfaces have.
        let contrast = dice.mostly_low(0.04, 0.8);
        let others = [1.0, -0.6, 0.5, -0.3].map(|share| {
            let tint = Vec3::new(dice.around_zero(0.2), dice.around_zero(0.2), dice.around_zero(0.2));
            base.filter(tint.map(|tint| 1.0 - contrast * (share + tint)))
        });
        Colors { base, others }
    }
}

fn color(dice: &mut Dice) -> Vec3 {
    let (brightness, tint) = (dice.mostly_low(0.05, 0.8), dice.pick([0.05, 0.25, 0.9]));
    [(); 3].map(|()| brightness * (1.0 + dice.between(-tint, tint))).into()
}
