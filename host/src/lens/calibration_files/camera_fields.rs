//! The camera that the fields of a file describe, whatever program wrote them.

use super::yaml::{Field, Fields, plain};
use crate::{
    error::{Error, Result},
    lens::{CameraModel, Lens, LensModel},
};

/// Names of one thing. The first is used in messages.
type Names = &'static [&'static str];

/// A matrix, `fx fy cx cy`, or fields of these names.
const MATRIX: Names = &[
    "camera_matrix",
    "K",
    "camera_mat",
    "cam_matrix",
    "intrinsic_matrix",
    "intrinsics",
    "intrinsic",
    "camera_intrinsics",
    "mtx",
    "projection_parameters",
];
const PINHOLE: [Names; 4] = [&["fx"], &["fy"], &["cx", "ppx"], &["cy", "ppy"]];
/// With the misspelling that copies of a tutorial have.
const COEFFICIENTS: Names = &[
    "distortion_coefficients",
    "distortion_coefficents",
    "distortion_coeffs",
    "distortion_coeff",
    "distortion_parameters",
    "distortion",
    "dist_coefficients",
    "dist_coeffs",
    "dist_coeff",
    "dist_coefs",
    "dist_coef",
    "dist",
    "D",
    "coeffs",
];
const SIZE: Names =
    &["image_size", "resolution", "camera_resolution", "image_resolution", "img_size", "imager_size", "frame_size", "size"];
const SIDES: [[&str; 2]; 5] = [
    ["image_width", "image_height"],
    ["width", "height"],
    ["img_width", "img_height"],
    ["frame_width", "frame_height"],
    ["w", "h"],
];
const MODEL: Names = &[
    "distortion_model",
    "dist_model",
    "distortion_type",
    "lens_model",
    "camera_model",
    "model_type",
    "camera_type",
    "camera.type",
];
/// Names of models that tell nothing about the distortion.
const PINHOLES: [&str; 3] = ["", "pinhole", "perspective"];

/// Models of distortion that files do not tell apart.
struct Kind {
    names: Names,
    /// The numbers of coefficients, in ascending order.
    counts: &'static [usize],
    /// The models in ascending order of their coefficients.
    models: &'static [LensModel],
}

const PLUMB_BOB: &[LensModel] = &[LensModel::PlumbBob];
const POLYNOMIALS: &[LensModel] = &[LensModel::PlumbBob, LensModel::Rational, LensModel::ThinPrism];
static KINDS: [&Kind; 4] = [
    &Kind { names: &["plumb_bob", "radtan", "radial_tangential", "brown_conrady"], counts: &[4, 5], models: PLUMB_BOB },
    &OPENCV,
    &FISHEYE,
    &Kind { names: &["none", "no_distortion"], counts: &[0], models: PLUMB_BOB },
];
/// OpenCV's polynomials, which files without the name of a model have.
static OPENCV: Kind = Kind { names: &["rational_polynomial", "rational"], counts: &[0, 4, 5, 8, 12, 14], models: POLYNOMIALS };
static FISHEYE: Kind = Kind {
    names: &["equidistant", "fisheye", "kannala_brandt", "kannala_brandt8"],
    counts: &[4],
    models: &[LensModel::Equidistant],
};

/// The only camera of a file.
pub fn read(fields: Fields) -> Result<CameraModel> {
    let path = fields.path;
    let one_of = |names: &[String]| {
        let found = format!("{} cameras ({})", names.len(), names.join(", "));
        Err(Error::format(path, found, "one: keep the one that takes the images"))
    };
    let names: Vec<String> = fields.names().map(String::from).collect();
    let numbered: Vec<String> = names.iter().filter(|name| is_numbered(name)).cloned().collect();
    // ORB-SLAM's pairs.
    if names.iter().any(|name| plain(name).starts_with("camera2.")) {
        return one_of(&["Camera1".into(), "Camera2".into()]);
    }
    let outer_size = size(&fields, true)?;
    let mut cameras = cameras(fields);
    let Some(camera) = cameras.pop() else {
        if numbered.len() > 1 {
            return one_of(&numbered);
        }
        let names: Vec<&str> = names.iter().take(5).map(String::as_str).collect();
        let found = if names.is_empty() { "no fields".into() } else { format!("the fields {}", names.join(", ")) };
        return Err(Error::format(path, found, "camera_matrix and distortion_coefficients (ROS, OpenCV) or cam0 (Kalibr)"));
    };
    if !cameras.is_empty() {
        let names: Vec<String> = cameras.iter().chain([&camera]).map(|camera| camera.name().into()).collect();
        return one_of(&names);
    }
    // First, as some programs keep other things under the same names.
    let kind = kind(&camera)?;
    let (focal_px, principal_point) = pinhole(&camera)?;
    let size = size(&camera, false)?.or(outer_size);
    // Kalibr always writes the size, last: a file without it is cut.
    if size.is_none() && plain(camera.name()).trim_end_matches(|letter: char| letter.is_ascii_digit()) == "cam" {
        camera.required(&["resolution"])?;
    }
    Ok(CameraModel { size, focal_px, principal_point, lens: lens(&camera, kind)? })
}

/// Returns true for a name such as `K1`, `cam0` or `camera_matrix_left`: a file that has several has several cameras.
fn is_numbered(name: &str) -> bool {
    let name = plain(name);
    let sides = ["left", "right"];
    let bare = sides.iter().fold(name.trim_end_matches(|letter: char| letter.is_ascii_digit()), |name, side| {
        name.strip_suffix(side).or(name.strip_prefix(side)).unwrap_or(name)
    });
    bare != name && MATRIX.iter().chain(&["m", "p", "cam", "camera"]).any(|known| plain(known) == bare)
}

/// The mappings that describe a camera: all fields, or else those within them.
fn cameras<'a>(fields: Fields<'a>) -> Vec<Fields<'a>> {
    match [MATRIX, PINHOLE[0], COEFFICIENTS].iter().any(|names| fields.field(names).is_some()) {
        true => vec![fields],
        false => fields.mappings().flat_map(cameras).collect(),
    }
}

/// The focal lengths and the principal point.
fn pinhole(fields: &Fields) -> Result<([f64; 2], [f64; 2])> {
    const EXPECTED: &str = "fx 0 cx, 0 fy cy, 0 0 1";
    let scalars = |fields: &Fields| {
        let [fx, fy, cx, cy] = PINHOLE.map(|names| fields.required(names)?.number());
        Ok(([fx?, fy?], [cx?, cy?]))
    };
    if fields.field(MATRIX).is_none() && fields.field(PINHOLE[0]).is_some() {
        return scalars(fields);
    }
    let field = fields.required(MATRIX)?;
    if let Some(inner) = field.fields().ok().filter(|inner| inner.field(PINHOLE[0]).is_some()) {
        return scalars(&inner);
    }
    let matrix = match field.numbers()?[..] {
        [fx, fy, cx, cy] => [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        // Column by column, as Open3D and MATLAB write it.
        [fx, 0.0, 0.0, skew, fy, 0.0, cx, cy, 1.0] => [fx, skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        [a, b, c, d, e, f, g, h, i] => [a, b, c, d, e, f, g, h, i],
        ref numbers => return Err(field.error(format!("{} numbers", numbers.len()), format!("4: fx fy cx cy, or 9: {EXPECTED}"))),
    };
    match matrix {
        [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0] => Ok(([fx, fy], [cx, cy])),
        [_, skew, _, 0.0, _, _, 0.0, 0.0, 1.0] => Err(field.error(format!("a skew of {skew}"), "a camera without skew")),
        _ => Err(field.error("no camera matrix", EXPECTED)),
    }
}

/// Width and height, if the file has them. What stands around the fields of a camera may be an `[image]` with them.
fn size(fields: &Fields, is_outer: bool) -> Result<Option<[usize; 2]>> {
    let mut sizes = Vec::new();
    for field in SIZE.iter().filter_map(|name| fields.field(&[name])) {
        sizes.extend(field.size()?.map(|size| (size, field.name)));
    }
    for [width, height] in SIDES {
        if fields.field(&[width]).or(fields.field(&[height])).is_some() {
            let [width, height] = [fields.required(&[width])?, fields.required(&[height])?];
            sizes.push(([width.pixels()?, height.pixels()?], width.name));
        }
    }
    if let Some(inner) = fields.field(&["image"]).filter(|_| is_outer).and_then(|image| image.fields().ok()) {
        sizes.extend(size(&inner, false)?.map(|size| (size, "image".into())));
    }
    let Some((first, name)) = sizes.first() else { return Ok(None) };
    match sizes.iter().find(|(size, _)| size != first) {
        None => Ok(Some(*first)),
        Some((other, other_name)) => {
            let [(w, h), (v, u)] = [(first[0], first[1]), (other[0], other[1])];
            Err(Error::format(fields.path, format!("{w}x{h} pixels in {name}, but {v}x{u} in {other_name}"), "one size"))
        }
    }
}

fn lens(fields: &Fields, kind: &Kind) -> Result<Lens> {
    let (count, models) = (|given: usize| kind.counts.iter().rfind(|&&count| count <= given).copied(), kind.models);
    let list = fields.field(COEFFICIENTS);
    let inner = list.as_ref().and_then(|list| list.fields().ok()).filter(|inner| inner.field(&["data"]).is_none());
    let named = inner.as_ref().unwrap_or(fields);
    let (field, given) = match list {
        Some(field) if inner.is_none() => (Some(field.name.clone()), field.numbers()?),
        _ if named.field(&["k1"]).is_some() => (None, named_coefficients(named, models)?),
        _ if kind.counts == [0] => return Ok(Lens::IDEAL),
        _ => {
            return Err(fields
                .required(COEFFICIENTS)
                .map_or_else(|error| error, |field| field.error("no k1", "k1, k2 and so on")));
        }
    };
    let field = field.unwrap_or_else(|| "k1 and so on".into());
    let wrong = |found: String, expected: String| Error::format(fields.path, format!("{found} in {field}"), expected);
    let used = count(given.len()).filter(|&used| given[used..].iter().all(|&surplus| surplus == 0.0));
    let Some(used) = used else {
        let counts: Vec<String> = kind.counts.iter().map(usize::to_string).collect();
        let expected = format!("{} for {}", counts.join(" or "), kind.names[0]);
        return Err(wrong(format!("{} coefficients", given.len()), expected));
    };
    // Zeros at the end need no model that has them.
    let needed = given[..used].iter().rposition(|&coefficient| coefficient != 0.0).map_or(0, |last| last + 1);
    let model = models.iter().copied().find(|model| model.coefficient_names().len() >= needed).unwrap_or(models[0]);
    let mut coefficients = given[..needed].to_vec();
    coefficients.resize(model.coefficient_names().len(), 0.0);
    Lens::new(model, &coefficients).map_err(|error| wrong(error.to_string(), "those of the model".into()))
}

/// Coefficients in fields of their own, such as `k1`. Those that are absent are 0.
fn named_coefficients(fields: &Fields, models: &[LensModel]) -> Result<Vec<f64>> {
    let names = models[models.len() - 1].coefficient_names();
    for required in &names[..4] {
        fields.required(&[required])?;
    }
    names.iter().map(|name| fields.field(&[name]).map_or(Ok(0.0), |field| field.number())).collect()
}

/// The kind of model that the file names.
fn kind(fields: &Fields) -> Result<&'static Kind> {
    let mut named: Option<(&'static Kind, Field)> = None;
    for field in MODEL.iter().filter_map(|name| fields.field(&[name])) {
        let name = plain(field.text()?);
        if PINHOLES.contains(&&name[..]) {
            continue;
        }
        let Some(&kind) = KINDS.iter().find(|kind| kind.names.iter().any(|known| plain(known) == name)) else {
            let known: Vec<&str> = KINDS.iter().map(|kind| kind.names[0]).collect();
            return Err(field.error(format!("{:?}", field.text()?), format!("pinhole, {}", known.join(", "))));
        };
        match &named {
            Some((other, first)) if other.names != kind.names => {
                let found = format!("{} in {}, but {} in {}", first.text()?, first.name, field.text()?, field.name);
                return Err(Error::format(fields.path, found, "one model"));
            }
            _ => named = Some((kind, field)),
        }
    }
    // Of OpenCV's sample program.
    let Some(fisheye) = fields.field(&["fisheye_model"]) else { return Ok(named.map_or(&OPENCV, |(kind, _)| kind)) };
    let is_fisheye = fisheye.number()? != 0.0;
    match named {
        Some((kind, field)) if is_fisheye != (kind.models == [LensModel::Equidistant]) => {
            let found = format!("{} in {}, but fisheye_model = {}", field.text()?, field.name, u8::from(is_fisheye));
            Err(Error::format(fields.path, found, "one model"))
        }
        Some((kind, _)) => Ok(kind),
        None => Ok(if is_fisheye { &FISHEYE } else { &OPENCV }),
    }
}
