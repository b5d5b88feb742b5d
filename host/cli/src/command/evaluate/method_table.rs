//! The methods of variants.

use multiscopic::{Method, Result, stereo::MethodName};

use crate::command::{
    options::{BaselineOptions, MethodOptions},
    variant::Variant,
};

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
        let long_baselines = long.long_baselines()?;
        let mut names: Vec<MethodName> = variants.iter().map(|variant| variant.method).collect();
        names.dedup();
        options.check_block_size(&names, block_size)?;
        let mut table = MethodTable { long, methods: Vec::new() };
        for variant in variants {
            if table.find(variant).is_none() {
                let (name, views) = table.key(variant);
                let method = options.method(name, block_size, views)?;
                table.methods.push(((name, views), Method { long_baselines, ..method }));
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
