//! Random colours, textures and finishes.

use super::flaws::Dice;
use crate::scene::{
    description::{Finish, Object},
    geometry::{Pose, Shape, Vec3},
    texture::{Motif, Placement, Texture},
};

/// The place where a random scene is captured, and the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Setting {
    /// Anything, by a small and noisy camera on a cheap stage.
    #[default]
    Field,
    /// Before walls that are often plain, by a good camera on an exact stage, as most published data sets are.
    Studio,
}

/// A kind of objects that are hard to match.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectKind {
    /// Polished blocks, balls and columns. They mirror what is around them, which each view sees at another place of them.
    Shiny,
    /// Panels, blocks, balls and columns of a single colour, which gives matching nothing to hold on to.
    Blank,
    /// Rods of 0.8 to 4.4 pixels in images that are 256 pixels wide, and of proportionally more in wider ones.
    Thin,
    /// Boards that face the camera, with a motif that repeats exactly along rows and columns, at 5 to 20 pixels in images that are
    /// 256 pixels wide.
    Repeating,
    /// Thick bars in front of a board, with deep slits of 2 to 9 pixels between them, along rows or columns: views across the slits
    /// do not see their ground.
    Slits,
}

/// The looks of the objects of one scene.
#[derive(Clone)]
pub struct Coatings {
    range: Range,
    /// The share of objects that look alike, and how they look.
    alike: f64,
    common: Coating,
    /// The kind of the objects, if it is chosen.
    kind: Option<ObjectKind>,
}

/// From what the looks of a scene are drawn.
#[derive(Clone)]
struct Range {
    /// The share of objects that are blank, and the share of backdrops.
    blank: f64,
    blank_backdrop: f64,
    /// The share of objects whose finish reflects.
    glossy: f64,
    /// The most sizes of details that a texture has.
    octaves: u32,
    /// A colour that many objects have, more or less.
    tint: Option<Vec3>,
}

/// The look of one object.
#[derive(Clone, Copy)]
pub struct Coating {
    texture: Texture,
    finish: Finish,
    /// The size of a unit of the texture in pixels.
    zoom: f64,
    /// The origin of the texture.
    pose: Pose,
}

impl Coatings {
    pub fn new(dice: &mut Dice, setting: Setting) -> Coatings {
        let range = match setting {
            Setting::Field => {
                let blank = dice.pick([0.05, 0.15, 0.35, 0.7]);
                Range { blank, blank_backdrop: blank, glossy: dice.pick([0.0, 0.2, 0.5]), octaves: 5, tint: None }
            }
            Setting::Studio => Range {
                blank: dice.pick([0.05, 0.1, 0.2, 0.4]),
                blank_backdrop: dice.pick([0.1, 0.3, 0.6]),
                glossy: dice.pick([0.0, 0.0, 0.1, 0.3]),
                octaves: 8,
                tint: if dice.happens(0.4) { Some(color(dice)) } else { None },
            },
        };
        let common = coating(dice, &range, range.blank, true);
        Coatings { range, alike: dice.pick([0.0, 0.0, 0.0, 0.6]), common, kind: None }
    }

    /// The looks of objects of a kind.
    pub fn of_kind(&self, kind: ObjectKind) -> Coatings {
        Coatings { kind: Some(kind), ..self.clone() }
    }

    /// The look of the next object. Textures that have two dimensions are for panels, which are `flat`.
    pub fn next(&self, dice: &mut Dice, flat: bool) -> Coating {
        match self.kind {
            Some(kind) => coating(dice, &self.range, 0.0, flat).of_kind(dice, kind),
            None => self.next_of(dice, self.range.blank, flat),
        }
    }

    /// The look of a part of the backdrop.
    pub fn backdrop(&self, dice: &mut Dice, flat: bool) -> Coating {
        self.next_of(dice, self.range.blank_backdrop, flat)
    }

    fn next_of(&self, dice: &mut Dice, blank: f64, flat: bool) -> Coating {
        if dice.happens(self.alike) { self.common } else { coating(dice, &self.range, blank, flat) }
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

    /// The look of an object of a kind that looks like this otherwise.
    fn of_kind(self, dice: &mut Dice, kind: ObjectKind) -> Coating {
        match kind {
            ObjectKind::Shiny => Coating { finish: Finish::Polished, ..self },
            ObjectKind::Blank => Coating { texture: Texture::Plain(color(dice)), finish: Finish::Matte, ..self },
            ObjectKind::Thin | ObjectKind::Slits => self,
            ObjectKind::Repeating => {
                let light = color(dice);
                let colors = [light, light * dice.between(0.1, 0.5)];
                let texture =
                    Texture::Repeated { motif: dice.pick(Motif::ALL), colors, pitch: dice.between(5.0, 20.0), clouds: 0.0 };
                // A unit of the texture is a pixel, and its axes are those of the board.
                Coating { texture, finish: Finish::Matte, zoom: 1.0, pose: Pose::at(Vec3::ZERO) }
            }
        }
    }

    /// The same look, of which another part is seen.
    pub fn moved(&self, dice: &mut Dice) -> Coating {
        Coating { pose: self.pose.moved([dice.between(-500.0, 500.0), dice.between(-500.0, 500.0), 0.0]), ..*self }
    }
}

fn coating(dice: &mut Dice, range: &Range, blank: f64, flat: bool) -> Coating {
    let colors = Colors::new(dice, range.tint);
    let texture = if dice.happens(blank) { blank_texture(dice, &colors) } else { texture(dice, &colors, range.octaves, flat) };
    let finish = match texture {
        Texture::Brushed(_) => Finish::Brushed,
        _ if dice.happens(range.glossy) => dice.pick([Finish::Satin, Finish::Glazed, Finish::Glazed]),
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

fn texture(dice: &mut Dice, colors: &Colors, octaves: u32, flat: bool) -> Texture {
    let [base, other] = [colors.base, colors.others[0]];
    let octaves = dice.count(2, octaves) as u8;
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
    fn new(dice: &mut Dice, tint: Option<Vec3>) -> Colors {
        let base = match tint {
            Some(tint) if dice.happens(0.4) => tint * dice.between(0.8, 1.2),
            _ => color(dice),
        };
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
