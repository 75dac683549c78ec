//! The client against a twin: what it asks for, what it makes of noise, and that it never hangs.

use std::collections::VecDeque;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use freshet::param::{COUNT, TABLE};
use freshet::protocol::BootRecord;
use freshet_host::client::{Client, Error, Event, Link};
use freshet_host::twin::Twin;

fn client() -> Client {
    Client::over(Twin::example().unwrap()).unwrap()
}

fn refusal<T: std::fmt::Debug>(result: Result<T, Error>) -> String {
    match result {
        Err(Error::Refused(why)) => why,
        other => panic!("{other:?}"),
    }
}

#[test]
fn everything_can_be_asked_for() {
    let mut board = client();
    let hello = board.hello().unwrap();
    assert_eq!((hello.board.as_str(), hello.seed), ("f407", 7));
    let table = board.table("").unwrap();
    assert_eq!(table.len(), COUNT);
    for (row, param) in table.iter().zip(&TABLE) {
        assert_eq!((row.id, row.path.as_str()), (param.id, param.path));
    }
    assert_eq!(board.table("mix.").unwrap().len(), 4);
    assert_eq!(board.values().unwrap().len(), COUNT);

    let scenes = board.scenes().unwrap();
    assert!(scenes[0].plays && scenes.len() > 5);
    let at = board.scene("light rain").unwrap();
    assert!(at > hello.at);
    assert!(board.scenes().unwrap()[scenes.len() - 1].number > 0);
    assert!(board.scene_number(2).unwrap() >= at);
    assert!(
        board
            .set(&[("mix.level", -9.0), ("water.rate", 50.0)], Some(0.0))
            .unwrap()
            >= at
    );
    board.poll(Duration::from_millis(50)).unwrap();
    assert_eq!(
        board.get(&["water.rate", "mix.level"]).unwrap(),
        [50.0, -9.0]
    );
    let all: Vec<&str> = TABLE.iter().map(|param| param.path).collect();
    assert_eq!(board.get(&all).unwrap().len(), COUNT);

    board.store(4, "mine").unwrap();
    board.store(0, "").unwrap();
    let presets = board.presets().unwrap();
    assert_eq!((presets[1].slot, presets[1].name.as_str()), (4, "mine"));
    assert_eq!(board.boot().unwrap(), BootRecord::Default);
    board.set_boot(&BootRecord::Preset(4)).unwrap();
    assert_eq!(board.boot().unwrap(), BootRecord::Preset(4));
    assert!(board.recall(4).unwrap() > at);
    assert!(board.trigger(Some(3.0), None, None).unwrap() > at);
    assert!(board.mute(true).unwrap() > at);
    assert_eq!(board.status().unwrap().status().cause, "power-on");
    let again = board.restart().unwrap();
    assert!(again.at < at);
    assert_eq!(board.get(&["mix.level"]).unwrap(), [-9.0]);
    board.set_boot(&BootRecord::Default).unwrap();
    board.erase(4).unwrap();
    assert_eq!(refusal(board.recall(4)), "nothing is stored in slot 4");
}

#[test]
fn what_is_refused_is_told_in_the_boards_words() {
    let mut board = client();
    assert_eq!(
        refusal(board.set(&[("water.rat", 1.0)], None)),
        "no parameter `water.rat`; did you mean `water.rate`?"
    );
    assert_eq!(
        refusal(board.scene("nowhere")),
        "no scene `nowhere`; `scene` lists them"
    );
    assert_eq!(
        refusal(board.set(&[("mix.level", 0.0)], Some(-1.0))),
        "a ramp of -1 s; expected 0 to 3600 s"
    );
    assert_eq!(
        refusal(board.set_ids(&[(1, 0.0); 25], None)),
        "more than 24 parameters at once"
    );
    assert_eq!(refusal(board.get_ids(&[9999])), "no parameter of id 9999");
    let partly = board.set(&[("mix.level", 99.0), ("mix.tone", 1.0)], None);
    let Err(Error::Partly { refused, at }) = partly else {
        panic!("{partly:?}");
    };
    assert_eq!(refused, ["mix.level cannot be 99; expected -80 to 24 dB"]);
    assert!(at > 0);
    let long = "x".repeat(400);
    assert!(board.scene(&long).is_err());
    assert!(board.hello().is_ok());
}

#[test]
fn reports_come_until_they_are_not_wanted_any_more() {
    let mut board = client();
    board.subscribe(10).unwrap();
    for _ in 0..20 {
        // A question in between takes nothing away.
        board.get(&["mix.level"]).unwrap();
        let event = board.poll(Duration::from_millis(100)).unwrap();
        assert!(matches!(event, Some(Event::Status(_))), "{event:?}");
    }
    board.subscribe(0).unwrap();
    while board.poll(Duration::ZERO).unwrap().is_some() {}
    assert_eq!(board.poll(Duration::from_millis(100)).unwrap(), None);
}

/// What may be done to bytes on their way.
type Harm = fn(&mut Vec<u8>);

/// A twin behind a bad line.
struct Bad {
    twin: Twin,
    /// What is done to the bytes of each answer, one after the other.
    harm: VecDeque<Harm>,
    waiting: VecDeque<u8>,
    sent: Arc<AtomicU32>,
}

impl Link for Bad {
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.sent.fetch_add(1, Ordering::Relaxed);
        self.twin.write(bytes)
    }
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        if self.waiting.is_empty() {
            let count = self.twin.read(buffer, timeout)?;
            let mut bytes = buffer[..count].to_vec();
            if let (true, Some(harm)) = (count > 0, self.harm.pop_front()) {
                harm(&mut bytes);
            }
            self.waiting.extend(bytes);
        }
        let count = buffer.len().min(self.waiting.len());
        for place in &mut buffer[..count] {
            *place = self.waiting.pop_front().unwrap();
        }
        Ok(count)
    }
    fn name(&self) -> &str {
        "the bad line"
    }
}

fn bad(harm: &[Harm]) -> Result<Client, Error> {
    counted(harm, &Arc::default())
}

/// The same, and counts how often something is sent.
fn counted(harm: &[Harm], sent: &Arc<AtomicU32>) -> Result<Client, Error> {
    let mut twin = Twin::example().unwrap();
    // The greeting is there, and so is half a line that nobody ended.
    twin.receive(b"sett mix.lev");
    Client::over(Bad {
        twin,
        harm: harm.iter().copied().collect(),
        waiting: VecDeque::new(),
        sent: Arc::clone(sent),
    })
}

const SPOIL: Harm = |bytes| {
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x20;
};

const SWALLOW: Harm = Vec::clear;

#[test]
fn what_a_line_does_to_an_answer_is_mended_where_asking_again_is_harmless() {
    let keep = |_: &mut Vec<u8>| {};
    let half = |bytes: &mut Vec<u8>| drop(bytes.drain(..7));
    let noise = |bytes: &mut Vec<u8>| drop(bytes.splice(0..0, *b"\xff\x01\x01\x00\x80abc\xff"));
    for harm in [half, noise, SPOIL] {
        let mut board = bad(&[harm]).unwrap();
        assert_eq!(board.hello().unwrap().board, "f407");
    }
    // The first read has the greeting and the hello; then the answer to the question is hit.
    let mut board = bad(&[keep, SPOIL]).unwrap();
    assert_eq!(board.get(&["mix.level"]).unwrap().len(), 1);
    let mut board = bad(&[keep, SPOIL, SPOIL, SPOIL]).unwrap();
    board.set_timeout(Duration::from_millis(100));
    let answer = board.get(&["mix.level"]);
    assert!(matches!(answer, Err(Error::Damaged { .. })), "{answer:?}");
    // A bubble more would be heard: nothing is sent twice.
    let sent = Arc::default();
    let mut board = counted(&[keep, SPOIL], &sent).unwrap();
    board.set_timeout(Duration::from_millis(100));
    let answer = board.trigger(None, None, None);
    assert!(matches!(answer, Err(Error::Damaged { .. })), "{answer:?}");
    assert_eq!(sent.load(Ordering::Relaxed), 2);
}

#[test]
fn silence_and_strange_bytes_are_told_apart_and_end() {
    let begun = Instant::now();
    let error = bad(&[SWALLOW; 3]).err().unwrap();
    assert!(
        matches!(error, Error::Timeout { heard: 0, .. }),
        "{error:?}"
    );
    let words = error.to_string();
    assert!(
        words.starts_with("the bad line: no answer within 1s; is it the board's port"),
        "{words}"
    );

    struct Strange;
    impl Link for Strange {
        fn write(&mut self, _: &[u8]) -> io::Result<()> {
            Ok(())
        }
        fn read(&mut self, buffer: &mut [u8], _: Duration) -> io::Result<usize> {
            std::thread::sleep(Duration::from_millis(1));
            buffer[..5].copy_from_slice(b"\x83U\xaaz\n");
            Ok(5)
        }
        fn name(&self) -> &str {
            "strange"
        }
    }
    assert!(Client::over(Strange).is_err());
    assert!(begun.elapsed() < Duration::from_secs(10));

    struct Gone;
    impl Link for Gone {
        fn write(&mut self, _: &[u8]) -> io::Result<()> {
            Ok(())
        }
        fn read(&mut self, _: &mut [u8], _: Duration) -> io::Result<usize> {
            Err(io::ErrorKind::BrokenPipe.into())
        }
        fn name(&self) -> &str {
            "gone"
        }
    }
    let error = Client::over(Gone).err().unwrap().to_string();
    assert_eq!(
        error,
        "gone is gone (broken pipe); is the board still plugged in?"
    );
}
