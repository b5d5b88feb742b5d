//! The subjects of an evaluation: methods, sets of views and fusion rules, and the methods with their options.

use clap::Args;
use multiscopic::{Dataset, Error, Method, Result, evaluation::CameraSteps, images::Layout, stereo::MethodName};
use multiscopic_core::{Fusion, View, Views};

use crate::command::{
    options::{BaselineOptions, MethodOptions, named, views_of_count},
    variant::Variant,
};

/// The methods, views and fusion rules.
#[derive(Clone, Debug, Args)]
pub struct Comparison {
    /// Numbers of neighbours: 1 (stereo), 2, 4, or 8 for all of a 3x3 array [default: 1 and 2 or 4, as the data set has; all of a
    /// rig]
    #[arg(long, value_name = "1,2,4,8", value_delimiter = ',')]
    views: Vec<usize>,

    /// Layouts of neighbours: cross, or rows and columns of an array such as 3x3, 5x5 or 1x9
    #[arg(long, value_name = "3x3,5x5", value_delimiter = ',')]
    layout: Vec<Layout>,

    /// Baselines that are matched from short to long besides, such as 3,5: every set of neighbours also with those that the
    /// data set has in the same directions at these multiples
    #[arg(long, value_name = "3,5", value_delimiter = ',')]
    baselines: Vec<u8>,

    /// Camera steps in a baseline, for hci4d: 1, 2 or 4. With 1, views are at 1 to 4 baselines. Errors remain in pixels at 4
    /// steps
    /// [default: 4]
    #[arg(long, value_name = "N")]
    camera_steps: Option<CameraSteps>,

    /// Methods
    #[arg(long, value_parser = named::<MethodName>(), value_delimiter = ',', default_value = "bm", help_heading = "Matching")]
    methods: Vec<MethodName>,

    /// Fusion rules for the views' costs [default: min with one or two neighbours, heuristic with three or four, half with more;
    /// for net, and for sgm with a census, of several neighbours trimmed]
    #[arg(long, value_parser = named::<Fusion>(), value_delimiter = ',', help_heading = "Matching")]
    fusion: Vec<Fusion>,
}

impl Comparison {
    /// The data set with the baseline that is asked for.
    pub fn dataset(&self, dataset: Dataset) -> Result<Dataset> {
        self.camera_steps.map_or(Ok(dataset), |steps| dataset.with_camera_steps(steps))
    }

    /// Returns true if each number of views has the fusion rule that it has by default.
    pub fn has_default_fusion(&self) -> bool {
        self.fusion.is_empty()
    }

    /// Every method with every set of views, those of `--views` first and stereo before all others, and every fusion rule where
    /// there are several views.
    pub fn variants(&self, dataset: Dataset, options: &MethodOptions, long: &BaselineOptions) -> Result<Vec<Variant>> {
        let nearest = self.nearest(dataset)?;
        let has_none = |&&multiple: &&u8| !further(Views::CROSS, multiple).any(|view| dataset.has(view));
        if let Some(multiple) = self.baselines.iter().find(has_none) {
            let steps = if matches!(dataset, Dataset::Hci4d(_)) { ": use --camera-steps 1 or 2" } else { "" };
            return Err(Error::Usage(format!("--baselines includes {multiple}, but {dataset} has no view there{steps}")));
        }
        let mut variants = Vec::new();
        for &method in &self.methods {
            for &(layout, views) in &nearest {
                let fusions = self.fusions(views, options.default_fusion(method, views, long));
                for count in 0..=self.baselines.len() {
                    let views = at_baselines(dataset, views, &self.baselines[..count])?;
                    for &fusion in &fusions {
                        let variant = Variant { method, layout, views, fusion };
                        if !variants.contains(&variant) {
                            variants.push(variant);
                        }
                    }
                }
            }
        }
        Ok(variants)
    }

    /// The option for data sets that is given, if there is one.
    pub fn dataset_option(&self) -> Option<&'static str> {
        let options = [
            ("--layout", !self.layout.is_empty()),
            ("--baselines", !self.baselines.is_empty()),
            ("--camera-steps", self.camera_steps.is_some()),
        ];
        options.into_iter().find(|(_, is_given)| *is_given).map(|(option, _)| option)
    }

    /// Every method with every set of views of a rig, those of `--views` or all, and every fusion rule where there are several
    /// views.
    pub fn variants_of_rig(&self, rig: Views, options: &MethodOptions, long: &BaselineOptions) -> Result<Vec<Variant>> {
        let mut sets = Vec::new();
        for &count in &self.views {
            let views = views_of_count(count)?;
            if let Some(missing) = views.iter().find(|&view| !rig.contains(view)) {
                return Err(Error::Usage(format!("--views includes {count}, but the rig has no {missing} view")));
            }
            sets.push(views);
        }
        if sets.is_empty() {
            sets.push(rig);
        }
        let mut variants = Vec::new();
        for (&method, &views) in self.methods.iter().flat_map(|method| sets.iter().map(move |views| (method, views))) {
            let fusions = self.fusions(views, options.default_fusion(method, views, long));
            variants.extend(fusions.into_iter().map(|fusion| Variant { method, layout: None, views, fusion }));
        }
        Ok(variants)
    }

    /// The fusion rules for views.
    fn fusions(&self, views: Views, default: Fusion) -> Vec<Fusion> {
        match (&self.fusion[..], views.len()) {
            ([], _) => vec![default],
            // All rules agree on a single cost.
            ([first, ..], 1) => vec![*first],
            (fusions, _) => fusions.to_vec(),
        }
    }

    /// The views of `--views` and `--layout`, the latter with their layout unless it is one of the former's.
    fn nearest(&self, dataset: Dataset) -> Result<Vec<(Option<Layout>, Views)>> {
        let mut counts = self.views.clone();
        if counts.is_empty() && self.layout.is_empty() {
            counts = vec![1, dataset.views().len()];
        }
        counts.sort_unstable();
        let mut nearest = Vec::new();
        for &count in &counts {
            let views = views_of_count(count)?;
            if !has_all(dataset, views) {
                let has = |count: &usize| views_of_count(*count).is_ok_and(|views| has_all(dataset, views));
                let most = [8, 4, 2, 1].into_iter().find(has).unwrap_or_default();
                return Err(Error::Usage(format!(
                    "--views includes {count}, but {dataset} has only {most} neighbours: use 1 or {most}"
                )));
            }
            nearest.push((None, views));
        }
        for &layout in &self.layout {
            let views = layout.views();
            if let Some(view) = views.iter().find(|&view| !dataset.has(view)) {
                let steps = match dataset {
                    Dataset::Hci4d(steps) => format!(" at {steps} camera steps"),
                    _ => String::new(),
                };
                return Err(Error::Usage(format!("--layout includes {layout}, but {dataset} has no view {view}{steps}")));
            }
            let is_of_count = views_of_count(views.len()).is_ok_and(|same| same == views);
            nearest.push(((!is_of_count).then_some(layout), views));
        }
        Ok(nearest)
    }
}

/// `views`, and those that the data set has in the same directions at `multiples` of their distances.
fn at_baselines(dataset: Dataset, views: Views, multiples: &[u8]) -> Result<Views> {
    let mut all = views;
    for view in multiples.iter().flat_map(|&multiple| further(views, multiple)).filter(|&view| dataset.has(view)) {
        if !all.contains(view) && all.len() == Views::MAX {
            let (count, most) = (views.len(), Views::MAX);
            return Err(Error::Usage(format!("{count} views at all of --baselines are more than {most} in all")));
        }
        all = all.with(view);
    }
    Ok(all)
}

/// The views in the same directions at a multiple of their distances.
fn further(views: Views, multiple: u8) -> impl Iterator<Item = View> {
    views.iter().filter_map(move |view| view.times(multiple))
}

/// Returns true if a data set has all of `views`.
fn has_all(dataset: Dataset, views: Views) -> bool {
    views.iter().all(|view| dataset.has(view))
}

/// The methods of several variants, each loaded once. Those of a name differ by the number of views, on which penalties depend.
pub struct MethodTable<'a> {
    long: &'a BaselineOptions,
    methods: Vec<((MethodName, usize), Method)>,
}

impl<'a> MethodTable<'a> {
    /// The methods with these options.
    pub fn new(
        variants: &[Variant],
        options: &MethodOptions,
        block_size: Option<u8>,
        long: &'a BaselineOptions,
    ) -> Result<MethodTable<'a>> {
        let mut names: Vec<MethodName> = variants.iter().map(|variant| variant.method).collect();
        names.dedup();
        options.check_block_size(&names, block_size)?;
        let mut table = MethodTable { long, methods: Vec::new() };
        for variant in variants {
            if table.find(variant).is_none() {
                let method = options.method_at_baselines(variant.method, block_size, variant.views, long)?;
                table.methods.push((table.key(variant), method));
            }
        }
        Ok(table)
    }

    /// The method of one of the variants.
    pub fn get(&self, variant: &Variant) -> &Method {
        self.find(variant).expect("every variant has its method")
    }

    fn find(&self, variant: &Variant) -> Option<&Method> {
        self.methods.iter().find(|(key, _)| *key == self.key(variant)).map(|(_, method)| method)
    }

    fn key(&self, variant: &Variant) -> (MethodName, usize) {
        (variant.method, self.long.first(variant.views).len())
    }
}
