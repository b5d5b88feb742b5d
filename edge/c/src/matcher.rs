//! Begins a match, and computes its lines.

use core::{
    ffi::{c_int, c_void},
    ptr::NonNull,
};
use multiscopic_core::Disparity;

use crate::{
    methods::{Head, Method, lent},
    params::{CParams, CRegion, CView},
    pass::{Callback, ReadLine},
    status::Status,
};

/// See the header.
///
/// # Safety
/// The pointers are null or those of what their types say.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn multiscopic_memory_words(
    method: Option<&'static Method>,
    params: Option<&CParams>,
    region: Option<&CRegion>,
) -> usize {
    let words = method.zip(params).and_then(|(method, params)| (method.words)(params, region).ok());
    words.unwrap_or_default()
}

/// See the header.
///
/// # Safety
/// The pointers are null or those of what their types say. The memory has so many words, which nothing else uses before the match
/// is done with.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn multiscopic_begin(
    method: Option<&'static Method>,
    params: Option<&CParams>,
    region: Option<&CRegion>,
    memory: *mut u32,
    words: usize,
    matcher: Option<&mut Option<NonNull<Head>>>,
) -> Status {
    let (Some(method), Some(params), Some(matcher)) = (method, params, matcher) else { return Status::NullPointer };
    // SAFETY: as the caller promises.
    let begun = unsafe { lent(memory, words) }.and_then(|memory| (method.begin)(method, params, region, memory));
    *matcher = begun.ok();
    begun.err().unwrap_or(Status::Ok)
}

/// See the header.
///
/// # Safety
/// A match that has begun in memory that is as it was left, a callback for this context, and lines as wide as the region.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn multiscopic_next_line(
    matcher: Option<NonNull<Head>>,
    read: Option<ReadLine>,
    context: *mut c_void,
    disparities: *mut Option<Disparity>,
    confidences: *mut u8,
    line: Option<&mut u16>,
) -> Status {
    let (Some(head), Some(read), Some(line)) = (matcher, read, line) else { return Status::NullPointer };
    // SAFETY: as the caller promises. The borrow of the head ends here.
    let (method, width) = unsafe { (head.as_ref().method, head.as_ref().region.width()) };
    // SAFETY: as the caller promises.
    let Ok(disparities) = (unsafe { lent(disparities, width) }) else { return Status::NullPointer };
    // SAFETY: as the caller promises.
    let confidences = unsafe { lent(confidences, width) }.ok();
    // SAFETY: the match has begun by this method, and its memory is as it was left, as the caller promises.
    match unsafe { (method.next_line)(head, &mut Callback { read, context }, disparities, confidences) } {
        Ok(Some(v)) => {
            *line = v as u16;
            Status::Line
        }
        Ok(None) => Status::End,
        Err(status) => status,
    }
}

/// `multiscopic_wanted`: the line that a match waits for.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Wanted {
    view: CView,
    line: u16,
}

/// A line that was pushed, until it is taken, and then the line that is wanted.
struct Pushed {
    pixels: *const u8,
    width: usize,
    wanted: Option<Wanted>,
}

/// The callback of lines that are pushed, whose context is a [`Pushed`].
unsafe extern "C" fn take_pushed(context: *mut c_void, view: CView, line: u16, pixels: *mut u8) -> c_int {
    // SAFETY: `multiscopic_push_line` gave this context, and lent it to nothing else.
    let pushed = unsafe { &mut *context.cast::<Pushed>() };
    if pushed.pixels.is_null() {
        pushed.wanted = Some(Wanted { view, line });
        return 1;
    }
    // SAFETY: both are lines of the frame, and a pushed one is not in the memory of the match.
    unsafe { pixels.copy_from_nonoverlapping(pushed.pixels, pushed.width) };
    pushed.pixels = core::ptr::null();
    0
}

/// See the header.
///
/// # Safety
/// As [`multiscopic_next_line`], and the pixels are null or those of a line of the frame.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn multiscopic_push_line(
    matcher: Option<NonNull<Head>>,
    pixels: *const u8,
    disparities: *mut Option<Disparity>,
    confidences: *mut u8,
    line: Option<&mut u16>,
    wanted: Option<&mut Wanted>,
) -> Status {
    let (Some(head), Some(wanted)) = (matcher, wanted) else { return Status::NullPointer };
    // SAFETY: as the caller promises.
    let width = unsafe { head.as_ref().search.width() };
    let mut pushed = Pushed { pixels, width, wanted: None };
    let context = (&raw mut pushed).cast();
    // SAFETY: as the caller promises; the callback is that of this context.
    let status = unsafe { multiscopic_next_line(matcher, Some(take_pushed), context, disparities, confidences, line) };
    match (status, pushed.wanted) {
        (Status::SourceFailed, Some(next)) => {
            *wanted = next;
            Status::Wanted
        }
        (Status::Line | Status::End, _) if !pushed.pixels.is_null() => Status::NothingWanted,
        (status, _) => status,
    }
}
