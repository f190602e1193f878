/* Firmware of a coil controller with four coils, for an atmega2560 (an Arduino Mega) or any board
 * with the same chip. Plain C without libraries; the Arduino IDE compiles it as well, if the file is
 * named coils.ino.
 *
 *     avr-gcc -mmcu=atmega2560 -DF_CPU=16000000UL -Os -std=gnu99 -Wall -Wextra \
 *         -o coils.elf coils.c
 *     avr-objcopy -O ihex coils.elf coils.hex
 *     avrdude -c wiring -p m2560 -P /dev/ttyACM0 -b 115200 -D -U flash:w:coils.hex
 *
 * coils.toml is the actuation file for it: shoal drive --actuator coils:coils.toml ...
 *
 * What it promises:
 * - A pulse ends by itself after its time, and never lasts longer than LONGEST_MS.
 * - While the field is on, the computer must be heard at least every SILENCE_MS; else the field is
 *   off, and pulses are refused until the next packet "off".
 * - A duty beyond LARGEST_DUTY, a pulse beyond LONGEST_MS and a pulse of coils hotter than
 *   HOTTEST is refused whole.
 * - A pulse whose number it has carried out is answered again, and not carried out again.
 * - Damaged packets (CRC) have no effect.
 * - Should the program hang, the watchdog resets the chip after 60 ms, and the field is off.
 *
 * Pins: PWM of the coils right, up, left, down on PE3, PE4, PE5, PH3 (Arduino Mega 5, 2, 3, 6); the
 * enable input of the driver, high while the field is on, on PB7 (13, the LED); a temperature sensor
 * with 10 mV for each degree Celsius (LM35) on ADC0.
 *
 * Packets are those of pySerialTransfer, at 115200 baud:
 *   to the controller    0: number (uint16), milliseconds (uint16), duty of the four coils (uint8)
 *                        1: off, number (uint16)
 *                        2: the computer is alive, number (uint16)
 *   from the controller  8: number, temperature in degrees (uint16 each): the pulse has ended
 *                        9: number, temperature: the field is off
 *                       10: number, reason: refused (1 limit, 2 too hot, 3 silent before), or
 *                           ended early (4 silence)
 */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <stdint.h>
#include <string.h>

#ifndef F_CPU
#define F_CPU 16000000UL
#endif
#define BAUD_RATE 115200UL
#define COILS 4
#define LARGEST_DUTY 230 /* of 255 */
#define LONGEST_MS 1000
#define SILENCE_MS 100
#define HOTTEST 70 /* degrees Celsius */

#define START 0x7E
#define STOP 0x81
#define PULSE 0
#define OFF 1
#define ALIVE 2
#define DONE 8
#define IS_OFF 9
#define REFUSED 10

enum { LIMIT = 1, HOT, SILENT_BEFORE, SILENCE };

/* Time in milliseconds, counted by timer 1. */
static volatile uint16_t clock_ms;

ISR(TIMER1_COMPA_vect) { clock_ms++; }

static uint16_t now(void)
{
    uint16_t time;
    cli();
    time = clock_ms;
    sei();
    return time;
}

/* The field. */
static uint8_t is_on, is_silent;
static uint16_t began, lasts, heard, number, answered;
static uint8_t has_answered;

static void turn_off(void)
{
    PORTB &= ~_BV(PB7); /* the driver first */
    TCCR3A &= (uint8_t) ~(_BV(COM3A1) | _BV(COM3B1) | _BV(COM3C1));
    TCCR4A &= (uint8_t) ~_BV(COM4A1);
    PORTE &= (uint8_t) ~(_BV(PE3) | _BV(PE4) | _BV(PE5));
    PORTH &= (uint8_t) ~_BV(PH3);
    OCR3A = OCR3B = OCR3C = OCR4A = 0;
    is_on = 0;
}

static void turn_on(const uint8_t *duty)
{
    OCR3A = duty[0];
    OCR3B = duty[1];
    OCR3C = duty[2];
    OCR4A = duty[3];
    /* a coil with the duty 0 stays disconnected: fast PWM would make a short spike */
    if (duty[0]) TCCR3A |= _BV(COM3A1);
    if (duty[1]) TCCR3A |= _BV(COM3B1);
    if (duty[2]) TCCR3A |= _BV(COM3C1);
    if (duty[3]) TCCR4A |= _BV(COM4A1);
    is_on = 1;
    PORTB |= _BV(PB7);
}

static uint16_t temperature(void)
{
    ADMUX = _BV(REFS0); /* 5 V, ADC0 */
    ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
    while (ADCSRA & _BV(ADSC))
        ;
    return (uint16_t) ((uint32_t) ADC * 500 / 1024);
}

/* The line. */
static volatile uint8_t ring[256], ring_end;
static uint8_t ring_begin;

ISR(USART0_RX_vect) { ring[ring_end++] = UDR0; }

static void send_byte(uint8_t byte)
{
    while (!(UCSR0A & _BV(UDRE0)))
        ;
    UDR0 = byte;
}

static uint8_t crc8(const uint8_t *bytes, uint8_t length)
{
    uint8_t crc = 0, at, bit;
    for (at = 0; at < length; at++) {
        crc ^= bytes[at];
        for (bit = 0; bit < 8; bit++)
            crc = (uint8_t) (crc & 0x80 ? crc << 1 ^ 0x9B : crc << 1);
    }
    return crc;
}

static void send_packet(uint8_t id, uint16_t first, uint16_t second)
{
    uint8_t payload[4], length = 4, at, overhead = 0xFF, following = 0;
    payload[0] = (uint8_t) first;
    payload[1] = (uint8_t) (first >> 8);
    payload[2] = (uint8_t) second;
    payload[3] = (uint8_t) (second >> 8);
    for (at = length; at-- > 0;) {
        if (payload[at] != START) continue;
        payload[at] = following ? (uint8_t) (following - at) : 0;
        following = overhead = at;
    }
    send_byte(START);
    send_byte(id);
    send_byte(overhead);
    send_byte(length);
    for (at = 0; at < length; at++)
        send_byte(payload[at]);
    send_byte(crc8(payload, length));
    send_byte(STOP);
}

static void end_pulse(uint8_t reason)
{
    turn_off();
    if (reason) {
        has_answered = 0;
        send_packet(REFUSED, number, reason);
    } else {
        has_answered = 1;
        answered = number;
        send_packet(DONE, number, temperature());
    }
}

static void begin_pulse(const uint8_t *payload)
{
    uint16_t wanted = (uint16_t) (payload[0] | payload[1] << 8);
    uint16_t time = (uint16_t) (payload[2] | payload[3] << 8);
    uint8_t at, reason = 0;
    if (is_on && wanted == number) return; /* sent again: it is being carried out */
    if (has_answered && wanted == answered) {
        send_packet(DONE, answered, temperature());
        return;
    }
    if (is_on) turn_off();
    number = wanted;
    if (time == 0 || time > LONGEST_MS) reason = LIMIT;
    for (at = 0; at < COILS; at++)
        if (payload[4 + at] > LARGEST_DUTY) reason = LIMIT;
    if (!reason && temperature() > HOTTEST) reason = HOT;
    if (!reason && is_silent) reason = SILENT_BEFORE;
    if (reason) {
        send_packet(REFUSED, number, reason);
        return;
    }
    began = now();
    lasts = time;
    turn_on(payload + 4);
}

static void take_packet(uint8_t id, const uint8_t *payload, uint8_t length)
{
    uint16_t said = length >= 2 ? (uint16_t) (payload[0] | payload[1] << 8) : 0;
    if (id == PULSE && length == 4 + COILS) {
        begin_pulse(payload);
    } else if (id == OFF && length == 2) {
        turn_off();
        is_silent = 0;
        if (said == 0) has_answered = 0; /* a new drive begins to count again */
        send_packet(IS_OFF, said, temperature());
    } else if (!(id == ALIVE && length == 2)) {
        return;
    }
    heard = now();
}

static void take_byte(uint8_t byte)
{
    static uint8_t state, id, overhead, length, at, payload[16];
    uint8_t distance;
    switch (state) {
    case 0:
        if (byte == START) state = 1;
        return;
    case 1:
        id = byte;
        state = 2;
        return;
    case 2:
        overhead = byte;
        state = 3;
        return;
    case 3:
        length = byte;
        at = 0;
        state = length && length <= sizeof payload ? 4 : 0;
        return;
    case 4:
        payload[at++] = byte;
        if (at == length) state = 5;
        return;
    case 5:
        state = byte == crc8(payload, length) ? 6 : 0;
        return;
    default:
        state = 0;
        if (byte != STOP) return;
        for (at = overhead; at < length; at = (uint8_t) (at + distance)) {
            distance = payload[at];
            payload[at] = START;
            if (!distance) break;
        }
        take_packet(id, payload, length);
    }
}

int main(void)
{
    MCUSR = 0; /* else the watchdog could not be set again after it has reset the chip */
    wdt_enable(WDTO_60MS);
    DDRE |= _BV(PE3) | _BV(PE4) | _BV(PE5);
    DDRH |= _BV(PH3);
    DDRB |= _BV(PB7);
    turn_off();
    /* fast PWM of 8 bits, 62.5 kHz: nobody hears it, and the current of a coil is smooth */
    TCCR3A = _BV(WGM30);
    TCCR3B = _BV(WGM32) | _BV(CS30);
    TCCR4A = _BV(WGM40);
    TCCR4B = _BV(WGM42) | _BV(CS40);
    /* timer 1: 1 ms */
    TCCR1B = _BV(WGM12) | _BV(CS11) | _BV(CS10);
    OCR1A = F_CPU / 64 / 1000 - 1;
    TIMSK1 = _BV(OCIE1A);
    /* 115200 baud, 8 bits, double speed */
    UCSR0A = _BV(U2X0);
    UBRR0 = (F_CPU / 8 + BAUD_RATE / 2) / BAUD_RATE - 1;
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
    set_sleep_mode(SLEEP_MODE_IDLE);
    sei();
    for (;;) {
        wdt_reset();
        while (ring_begin != ring_end)
            take_byte(ring[ring_begin++]);
        if (is_on && (uint16_t) (now() - heard) >= SILENCE_MS) {
            is_silent = 1;
            end_pulse(SILENCE);
        } else if (is_on && (uint16_t) (now() - began) >= lasts) {
            end_pulse(0);
        }
        sleep_mode(); /* until the next byte or millisecond */
    }
}
