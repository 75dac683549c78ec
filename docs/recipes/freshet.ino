// A sensor plays a freshet board: a knob or a light sensor at A0 is the water's rate, a button at pin 2 a drop.
//
//   Arduino TX1  ->  board RX        (docs/boards.md has the board's pins)
//   Arduino RX1  <-  board TX
//   GND          --  GND
//
// The board speaks at 3.3 V. An Arduino of 5 V (Mega) needs two resistors on its TX: 1.8 kohm from TX1 to RX, 3.3 kohm
// from RX to GND. One of 3.3 V (Due, Zero, MKR, Nano 33, Teensy, ESP32) needs none.
// An Uno has only one serial port, which is the USB's as well: unplug the wires while you load the sketch, and write
// `#define BOARD Serial`.

#define BOARD Serial1

const int SENSOR = A0;
const int BUTTON = 2;

int last = -100;          // what was sent last, 0 to 1023
bool pressed = false;
char line[96];            // what the board is saying
byte length = 0;

void setup() {
  pinMode(BUTTON, INPUT_PULLUP);
  pinMode(LED_BUILTIN, OUTPUT);
  BOARD.begin(115200);
  delay(500);
  BOARD.print("\nscene brook\n");   // the first end of line ends whatever was half said
}

void loop() {
  int now = analogRead(SENSOR);
  if (abs(now - last) > 4) {        // a sensor at rest trembles
    last = now;
    // From 10 to 10 000 bubbles a second, in equal ratios: so the ear hears it.
    float rate = 10.0 * pow(1000.0, now / 1023.0);
    BOARD.print("set water.rate ");
    BOARD.print(rate, 1);
    BOARD.print(" 0.1\n");          // in 0.1 s
  }
  bool down = digitalRead(BUTTON) == LOW;
  if (down && !pressed) {
    BOARD.print("trigger 4 0.5\n"); // a bubble of 4 mm, 0.5 Pa
  }
  pressed = down;
  listen();
  delay(20);                        // 50 lines a second are plenty
}

// The light goes on when the board refuses something, and off when it does the next thing.
void listen() {
  while (BOARD.available()) {
    char c = BOARD.read();
    if (c == '\n') {
      line[length] = 0;
      length = 0;
      if (strncmp(line, "error", 5) == 0) digitalWrite(LED_BUILTIN, HIGH);
      if (strncmp(line, "ok", 2) == 0) digitalWrite(LED_BUILTIN, LOW);
    } else if (length < sizeof line - 1) {
      line[length++] = c;
    }
  }
}
