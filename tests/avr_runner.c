/* Runs firmware of an atmega2560 in real time on libsimavr, with its UART on a pseudo-terminal.
 *
 *     avr_runner FIRMWARE.elf MILLIVOLTS
 *
 * It prints the name of the pseudo-terminal, and a line for each change of the enable pin PB7:
 * "on" or "off", the cycle, the cycle of the last byte that the firmware has received, and the duty
 * of the four coils. MILLIVOLTS is the voltage at ADC0. It ends with its standard input.
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <simavr/avr_adc.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#define FREQUENCY 16000000UL
#define BYTE_CYCLES (FREQUENCY / 11520) /* ten bits at 115200 baud */
#define SLICE (FREQUENCY / 2000)        /* cycles between two looks at the clock */

static FILE *out;
static int terminal, may_send = 1;
static avr_cycle_count_t last_byte;

static void on_output(struct avr_irq_t *irq, uint32_t value, void *avr)
{
    uint8_t byte = (uint8_t) value;
    (void) irq, (void) avr;
    if (write(terminal, &byte, 1) != 1) perror("write");
}

static void on_xon(struct avr_irq_t *irq, uint32_t value, void *avr)
{
    (void) irq, (void) value, (void) avr;
    may_send = 1;
}

static void on_xoff(struct avr_irq_t *irq, uint32_t value, void *avr)
{
    (void) irq, (void) value, (void) avr;
    may_send = 0;
}

static void on_pin(struct avr_irq_t *irq, uint32_t value, void *parameter)
{
    avr_t *avr = parameter;
    if (irq->value == value) return;
    fprintf(out, "%s %llu %llu %d %d %d %d\n", value ? "on" : "off", (unsigned long long) avr->cycle,
           (unsigned long long) last_byte, avr->data[0x98], avr->data[0x9A], avr->data[0x9C],
           avr->data[0xA8]);
    fflush(out);
}

static void no_sleep(avr_t *avr, avr_cycle_count_t cycles) { (void) avr, (void) cycles; }

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return time.tv_sec + 1e-9 * time.tv_nsec;
}

int main(int count, char **words)
{
    elf_firmware_t firmware;
    uint8_t buffer[256];
    ssize_t begin = 0, end = 0;
    uint32_t flags = 0;
    int other, state = cpu_Running;
    struct termios raw;
    if (count != 3) return 2;
    out = fdopen(dup(1), "w"); /* the library itself writes to the standard output */
    dup2(2, 1);
    memset(&firmware, 0, sizeof firmware);
    if (elf_read_firmware(words[1], &firmware)) return 2;
    avr_t *avr = avr_make_mcu_by_name("atmega2560");
    if (!avr) return 2;
    avr_init(avr);
    firmware.frequency = FREQUENCY;
    firmware.vcc = firmware.avcc = firmware.aref = 5000;
    avr_load_firmware(avr, &firmware);
    avr->frequency = FREQUENCY;
    avr->sleep = no_sleep;
    avr->log = LOG_ERROR;

    if (openpty(&terminal, &other, NULL, NULL, NULL)) return 2;
    tcgetattr(other, &raw);
    cfmakeraw(&raw);
    tcsetattr(other, TCSANOW, &raw);
    fcntl(terminal, F_SETFL, O_NONBLOCK);
    fprintf(out, "%s\n", ttyname(other));
    fflush(out);

    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_t *input = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(
        avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_output, avr);
    avr_irq_register_notify(
        avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), on_xon, avr);
    avr_irq_register_notify(
        avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), on_xoff, avr);
    avr_irq_register_notify(
        avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 7), on_pin, avr);
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0),
                  (uint32_t) atoi(words[2]));

    double began = now();
    avr_cycle_count_t looked = 0, sent = 0;
    while (state != cpu_Done && state != cpu_Crashed) {
        state = avr_run(avr);
        if (begin < end && may_send && avr->cycle - sent >= BYTE_CYCLES) {
            sent = last_byte = avr->cycle;
            avr_raise_irq(input, buffer[begin++]);
        }
        if (avr->cycle - looked < SLICE) continue;
        looked = avr->cycle;
        if (begin == end) {
            ssize_t got = read(terminal, buffer, sizeof buffer);
            begin = 0;
            end = got > 0 ? got : 0;
        }
        double ahead = began + (double) avr->cycle / FREQUENCY - now();
        struct pollfd standard = {.fd = 0, .events = POLLIN};
        if (poll(&standard, 1, 0) > 0 && read(0, &flags, 1) <= 0) break;
        if (ahead > 0) usleep((useconds_t) (ahead * 1e6));
        if (ahead < -0.05) began -= ahead; /* the computer is busy: simulated time stands still */
    }
    return state == cpu_Crashed;
}
