//! Where MIDI comes from: devices, behind the feature `midi`, and the standard input.

use std::io::{ErrorKind, Read};

use anyhow::Result;

use super::player::Player;

/// Reads raw MIDI bytes until there are no more.
pub fn read(mut input: impl Read, player: &mut Player) {
    let mut bytes = [0; 1024];
    loop {
        match input.read(&mut bytes) {
            Ok(0) => return,
            Ok(count) => player.feed(&bytes[..count]),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(_) => return,
        }
    }
}

#[cfg(feature = "midi")]
mod devices {
    use anyhow::{Context, Result, anyhow, bail};
    use midir::{Ignore, MidiInput, MidiInputConnection};

    use super::Player;

    /// A device that plays as long as this is kept.
    pub struct Device(#[expect(dead_code, reason = "kept, not used")] MidiInputConnection<Player>);

    fn input() -> Result<MidiInput> {
        let mut input = MidiInput::new("freshet").context(
            "this system has no MIDI (on Linux: is the kernel's ALSA sequencer there, and may this user use /dev/snd/seq?)",
        )?;
        input.ignore(Ignore::All);
        Ok(input)
    }

    fn names(input: &MidiInput) -> Vec<String> {
        let ports = input.ports();
        ports
            .iter()
            .filter_map(|port| input.port_name(port).ok())
            .collect()
    }

    /// The names of all devices.
    pub fn list() -> Result<Vec<String>> {
        Ok(names(&input()?))
    }

    /// Plays from the device of that name, or the only one that has it in its name.
    pub fn open(name: &str, player: Player) -> Result<Device> {
        let input = input()?;
        let all = names(&input);
        let found = choose(name, &all)?;
        let port = (input.ports().into_iter())
            .find(|port| input.port_name(port).is_ok_and(|own| own == found))
            .with_context(|| format!("the MIDI device {found} has gone"))?;
        let play = |_: u64, bytes: &[u8], player: &mut Player| player.feed(bytes);
        (input.connect(&port, "freshet bridge", play, player))
            .map(Device)
            .map_err(|error| anyhow!("cannot open the MIDI device {found}: {error}"))
    }

    fn choose<'a>(name: &str, all: &'a [String]) -> Result<&'a str> {
        if let Some(exact) = all.iter().find(|own| *own == name) {
            return Ok(exact);
        }
        let wanted = name.to_lowercase();
        let alike = all
            .iter()
            .filter(|own| own.to_lowercase().contains(&wanted));
        match alike.collect::<Vec<_>>().as_slice() {
            [one] => Ok(one),
            [] if all.is_empty() => bail!("no MIDI device was found (is it plugged in and on?)"),
            [] => bail!(
                "no MIDI device is called {name}; here are {}",
                all.join(", ")
            ),
            several => {
                let names: Vec<&str> = several.iter().map(|name| name.as_str()).collect();
                bail!(
                    "several MIDI devices are called {name}: {}",
                    names.join(", ")
                )
            }
        }
    }

    #[cfg(test)]
    mod tests {
        use super::choose;

        #[test]
        fn a_device_is_found_by_a_part_of_its_name() {
            let all = ["nanoKONTROL2 20:0", "Keys 24:0", "Keys 28:0"].map(str::to_owned);
            assert_eq!(choose("nanokontrol", &all).unwrap(), all[0]);
            assert_eq!(choose("Keys 28:0", &all).unwrap(), all[2]);
            let several = choose("keys", &all).unwrap_err().to_string();
            assert!(several.contains("Keys 24:0, Keys 28:0"), "{several}");
            let none = choose("drum", &all).unwrap_err().to_string();
            assert!(none.contains("nanoKONTROL2"), "{none}");
        }
    }
}

#[cfg(not(feature = "midi"))]
mod devices {
    use anyhow::{Result, bail};

    use super::Player;

    /// There is none.
    pub enum Device {}

    fn missing<T>() -> Result<T> {
        bail!(
            "this freshet was built without MIDI devices; build it with `cargo run --release -p freshet-host --features midi -- bridge …` \
             (on Debian and Ubuntu that needs the package libasound2-dev), or pipe a device's bytes into `freshet bridge … --midi -`"
        )
    }

    /// Says what is missing.
    pub fn list() -> Result<Vec<String>> {
        missing()
    }

    /// Says what is missing.
    pub fn open(_name: &str, _player: Player) -> Result<Device> {
        missing()
    }
}

pub use devices::Device;

/// The names of all MIDI devices.
///
/// # Errors
/// Where this was built without the feature `midi`, or the system has no MIDI.
pub fn list() -> Result<Vec<String>> {
    devices::list()
}

/// Plays from a device, by its name or a part of it that no other has, as long as what is returned is kept.
///
/// # Errors
/// As [`list`], and where there is no such device.
pub fn open(name: &str, player: Player) -> Result<Device> {
    devices::open(name, player)
}
