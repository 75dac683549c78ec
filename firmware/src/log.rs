//! Logs over RTT in a development build, nothing at all in a field build. Never from the audio path.

#[cfg(feature = "rtt")]
use defmt_rtt as _;

#[cfg(feature = "rtt")]
pub(crate) use defmt::{error, info};

#[cfg(feature = "rtt")]
defmt::timestamp!("{=u64:us}", embassy_time::Instant::now().as_micros());

/// What a log prints as its `Display` says.
#[cfg(feature = "rtt")]
pub(crate) use defmt::Display2Format as Display;
#[cfg(not(feature = "rtt"))]
pub(crate) struct Display<'a, T: ?Sized>(pub &'a T);

/// Takes what a log would, and does nothing with it.
#[cfg(not(feature = "rtt"))]
macro_rules! silent {
    ($($arg:expr),* $(,)?) => {{ $(let _ = &$arg;)* }};
}
#[cfg(not(feature = "rtt"))]
pub(crate) use {silent as error, silent as info};
