// SPDX-License-Identifier: GPL-2.0
/*
 * Serial ports on simulated EIA-485 buses.
 *
 * buses * ports ports, from /dev/ttyLAB0 on: all ports of a bus receive what one of them sends, in
 * the time that it takes on a wire.  Each character carries a ninth bit, derived from the sender's
 * termios (PARENB, PARODD, CMSPAR) and checked by the receiver's.  Therefore mark and space
 * parity, INPCK, PARMRK, rates that differ, collisions and breaks pass through the kernel's own
 * serial core and line discipline, and TIOCSRS485 and TIOCSERGETLSR are theirs.
 *
 * It is stricter than most chips: a character that is in the shift register when its port's
 * settings change is spoilt, as is one that meets another on its wire.
 *
 * A bus is a pair of wires shared by all ports, or, with full=, has a pair in each direction: port
 * 0 sends on one, the others on the other.
 *
 * With words=, port 0 of a bus is read and written as two bytes for each character, the ninth bit
 * (0 or 1) and then the others: so are the nine-bit ports of the TS-7800, whose driver was read for
 * it.  As there, a first byte that is neither 0 nor 1 is not sent; nothing is marked in what is
 * received.
 */
#include <linux/hrtimer.h>
#include <linux/module.h>
#include <linux/platform_device.h>
#include <linux/serial_core.h>
#include <linux/slab.h>
#include <linux/spinlock.h>
#include <linux/tty.h>
#include <linux/tty_flip.h>

#define DRIVER_NAME	"lab_uart9"
#define BUSES_MAX	8
#define PORTS_MAX	8

/* What may be wrong with a received character: the bits of read_status_mask. */
#define STATUS_FRAMING	BIT(0)
#define STATUS_PARITY	BIT(1)
#define STATUS_BREAK	BIT(2)
/* In ignore_status_mask: nothing is received at all. */
#define STATUS_DEAF	BIT(3)

static unsigned int buses = 1;
module_param(buses, uint, 0444);
MODULE_PARM_DESC(buses, "number of buses [1]");

static unsigned int ports = 4;
module_param(ports, uint, 0444);
MODULE_PARM_DESC(ports, "ports of each bus [4]");

static bool full[BUSES_MAX];
module_param_array(full, bool, NULL, 0444);
MODULE_PARM_DESC(full, "which buses have a pair of wires each way [none]");

static bool words[BUSES_MAX];
module_param_array(words, bool, NULL, 0444);
MODULE_PARM_DESC(words, "which buses' port 0 has two bytes for each character [none]");

struct uart9_bus {
	/* Guards what a character on the wire and its receivers share.  Taken inside port.lock. */
	spinlock_t lock;
	bool full;
	struct uart9_port *ports;
};

struct uart9_port {
	struct uart_port port;
	struct uart9_bus *bus;
	/* Runs while something is sent: expires at the end of each character. */
	struct hrtimer timer;
	bool words;

	/* Guarded by bus->lock. */
	tcflag_t cflag;
	unsigned int baud;
	u64 char_ns;
	bool open;
	/* The shift register. */
	bool sending;
	bool preparing;		/* RTS is on, the first start bit is due at the next expiry */
	bool spoilt;
	bool ninth;
	u8 shifted;
	/* Of a character whose second byte is due, of a port with words. */
	bool has_ninth;
	bool next_ninth;
};

#define to_uart9(uart) container_of(uart, struct uart9_port, port)

static struct uart9_bus *all;
static struct platform_device *device;

static bool ninth_bit(tcflag_t cflag, u8 character)
{
	bool odd = cflag & PARODD;

	/* Without parity a receiver that waits for it takes the stop bit, a one. */
	if (!(cflag & PARENB))
		return true;
	if (cflag & CMSPAR)
		return odd;
	return (hweight8(character) & 1) != odd;
}

/* Whether two ports talk on the same pair of wires. */
static bool same_pair(const struct uart9_port *a, const struct uart9_port *b)
{
	const struct uart9_port *first = a->bus->ports;

	return !a->bus->full || (a == first) == (b == first);
}

/* Whether `to` hears what `from` sends. */
static bool hears(const struct uart9_port *to, const struct uart9_port *from)
{
	const struct serial_rs485 *rs485 = &to->port.rs485;

	if (!to->open || (to->port.ignore_status_mask & STATUS_DEAF))
		return false;
	if (to->bus->full)
		return !same_pair(to, from);
	/* The receiver of a transceiver that talks is off, unless asked for. */
	if (to == from || to->sending)
		return (rs485->flags & SER_RS485_ENABLED) ? rs485->flags & SER_RS485_RX_DURING_TX :
							    to != from;
	return true;
}

static unsigned int judge(struct uart9_port *to, const struct uart9_port *from)
{
	bool parity = to->cflag & PARENB;
	struct uart_icount *count = &to->port.icount;

	/* A space where the stop bit is due, or edges where none may be. */
	if (from->spoilt || to->baud != from->baud || (!parity && !to->words && !from->ninth)) {
		count->frame++;
		return STATUS_FRAMING;
	}
	if (parity && !to->words && from->ninth != ninth_bit(to->cflag, from->shifted)) {
		count->parity++;
		return STATUS_PARITY;
	}
	return 0;
}

static void receive(struct uart9_port *to, unsigned int status, u8 character)
{
	static const u8 flags[] = {
		[0] = TTY_NORMAL, [STATUS_FRAMING] = TTY_FRAME,
		[STATUS_PARITY] = TTY_PARITY, [STATUS_BREAK] = TTY_BREAK,
	};
	struct uart_port *uart = &to->port;

	uart->icount.rx++;
	/* What termios did not ask to be told is a character like any other. */
	uart_insert_char(uart, status, 0, character, flags[status & uart->read_status_mask]);
	tty_flip_buffer_push(&uart->state->port);
}

/* The character in the shift register has left: all others have it. */
static void deliver(struct uart9_port *from)
{
	unsigned int i;

	for (i = 0; i < ports; i++) {
		struct uart9_port *to = &from->bus->ports[i];

		if (!hears(to, from))
			continue;
		if (to->words) {
			judge(to, from);
			receive(to, 0, from->spoilt ? 0 : from->ninth);
			receive(to, 0, from->spoilt ? 0 : from->shifted);
		} else {
			receive(to, judge(to, from), from->spoilt ? 0 : from->shifted);
		}
	}
}

/* A character enters the shift register.  Those that talk at once spoil each other. */
static void shift(struct uart9_port *p, u8 character, bool ninth)
{
	unsigned int i;

	p->shifted = character;
	p->ninth = ninth;
	p->spoilt = false;
	p->sending = true;
	for (i = 0; i < ports; i++) {
		struct uart9_port *other = &p->bus->ports[i];

		if (other != p && other->sending && !other->preparing && same_pair(p, other))
			other->spoilt = p->spoilt = true;
	}
}

/* The next byte that was written.  Called with port.lock held. */
static bool next_byte(struct uart_port *uart, u8 *character)
{
	struct circ_buf *xmit = &uart->state->xmit;

	if (uart->x_char) {
		*character = uart->x_char;
		uart->x_char = 0;
	} else if (!uart_circ_empty(xmit) && !uart_tx_stopped(uart)) {
		*character = xmit->buf[xmit->tail];
		xmit->tail = (xmit->tail + 1) & (UART_XMIT_SIZE - 1);
	} else {
		return false;
	}
	uart->icount.tx++;
	return true;
}

/* The next character to send, with its ninth bit.  Called with port.lock and bus->lock held. */
static bool next_character(struct uart9_port *p, u8 *character, bool *ninth)
{
	while (next_byte(&p->port, character)) {
		if (!p->words) {
			*ninth = ninth_bit(p->cflag, *character);
			return true;
		}
		if (p->has_ninth) {
			p->has_ninth = false;
			*ninth = p->next_ninth;
			return true;
		}
		p->has_ninth = *character <= 1;
		p->next_ninth = *character;
	}
	return false;
}

static enum hrtimer_restart uart9_expired(struct hrtimer *timer)
{
	struct uart9_port *p = container_of(timer, struct uart9_port, timer);
	struct uart_port *uart = &p->port;
	enum hrtimer_restart again = HRTIMER_NORESTART;
	unsigned long flags;
	u8 character;
	bool ninth;

	spin_lock_irqsave(&uart->lock, flags);
	spin_lock(&p->bus->lock);
	if (!p->preparing)
		deliver(p);
	p->preparing = false;
	p->sending = false;
	if (next_character(p, &character, &ninth)) {
		shift(p, character, ninth);
		hrtimer_forward_now(timer, ns_to_ktime(p->char_ns));
		again = HRTIMER_RESTART;
	}
	spin_unlock(&p->bus->lock);
	if (uart_circ_chars_pending(&uart->state->xmit) < WAKEUP_CHARS)
		uart_write_wakeup(uart);
	spin_unlock_irqrestore(&uart->lock, flags);
	return again;
}

/* Called with port.lock held, also with nothing to send. */
static void uart9_start_tx(struct uart_port *uart)
{
	struct uart9_port *p = to_uart9(uart);
	const struct serial_rs485 *rs485 = &uart->rs485;
	u64 until_ns = p->char_ns;
	u8 character;
	bool ninth;

	spin_lock(&p->bus->lock);
	if (p->sending)
		goto out;
	if ((rs485->flags & SER_RS485_ENABLED) && rs485->delay_rts_before_send &&
	    (!uart_circ_empty(&uart->state->xmit) || uart->x_char)) {
		p->preparing = true;
		p->sending = true;
		until_ns = (u64)rs485->delay_rts_before_send * NSEC_PER_MSEC;
	} else if (next_character(p, &character, &ninth)) {
		shift(p, character, ninth);
	} else {
		goto out;
	}
	hrtimer_start(&p->timer, ns_to_ktime(until_ns), HRTIMER_MODE_REL_SOFT);
out:
	spin_unlock(&p->bus->lock);
}

static unsigned int uart9_tx_empty(struct uart_port *uart)
{
	struct uart9_port *p = to_uart9(uart);
	unsigned long flags;
	bool sending;

	spin_lock_irqsave(&p->bus->lock, flags);
	sending = p->sending;
	spin_unlock_irqrestore(&p->bus->lock, flags);
	return sending ? 0 : TIOCSER_TEMT;
}

static void uart9_set_termios(struct uart_port *uart, struct ktermios *termios,
			      const struct ktermios *old)
{
	struct uart9_port *p = to_uart9(uart);
	unsigned int baud = uart_get_baud_rate(uart, termios, old, 50, 4000000);
	unsigned long flags;

	spin_lock_irqsave(&uart->lock, flags);
	spin_lock(&p->bus->lock);
	if (p->sending && (p->baud != baud || ((p->cflag ^ termios->c_cflag) &
					       (CSIZE | CSTOPB | PARENB | PARODD | CMSPAR))))
		p->spoilt = true;
	p->baud = baud;
	p->cflag = termios->c_cflag;
	/* A port with words sends nine bits, whatever termios has. */
	p->char_ns = div_u64((u64)NSEC_PER_SEC * (p->words ? 11 : tty_get_frame_size(p->cflag)), baud);

	uart->read_status_mask = 0;
	if (termios->c_iflag & INPCK)
		uart->read_status_mask |= STATUS_FRAMING | STATUS_PARITY;
	if (termios->c_iflag & (IGNBRK | BRKINT | PARMRK))
		uart->read_status_mask |= STATUS_BREAK;
	uart->ignore_status_mask = 0;
	if (termios->c_iflag & IGNPAR)
		uart->ignore_status_mask |= STATUS_FRAMING | STATUS_PARITY;
	if (termios->c_iflag & IGNBRK)
		uart->ignore_status_mask |= STATUS_BREAK;
	if (!(termios->c_cflag & CREAD))
		uart->ignore_status_mask |= STATUS_DEAF;
	spin_unlock(&p->bus->lock);
	uart_update_timeout(uart, termios->c_cflag, baud);
	spin_unlock_irqrestore(&uart->lock, flags);
	tty_termios_encode_baud_rate(termios, baud, baud);
}

static void uart9_break_ctl(struct uart_port *uart, int on)
{
	struct uart9_port *p = to_uart9(uart);
	unsigned long flags;
	unsigned int i;

	if (!on)
		return;
	spin_lock_irqsave(&p->bus->lock, flags);
	for (i = 0; i < ports; i++) {
		struct uart9_port *to = &p->bus->ports[i];

		if (to != p && hears(to, p)) {
			to->port.icount.brk++;
			if (to->words)
				receive(to, 0, 0);
			receive(to, STATUS_BREAK, 0);
		}
	}
	spin_unlock_irqrestore(&p->bus->lock, flags);
}

static void uart9_set_open(struct uart9_port *p, bool open)
{
	unsigned long flags;

	spin_lock_irqsave(&p->bus->lock, flags);
	p->open = open;
	p->sending = false;
	p->preparing = false;
	p->has_ninth = false;
	spin_unlock_irqrestore(&p->bus->lock, flags);
}

static int uart9_startup(struct uart_port *uart)
{
	uart9_set_open(to_uart9(uart), true);
	return 0;
}

static void uart9_shutdown(struct uart_port *uart)
{
	struct uart9_port *p = to_uart9(uart);

	hrtimer_cancel(&p->timer);
	uart9_set_open(p, false);
}

/* The serial core keeps what rs485_supported lets through. */
static int uart9_rs485_config(struct uart_port *uart, struct ktermios *termios,
			      struct serial_rs485 *rs485)
{
	return 0;
}

static unsigned int uart9_get_mctrl(struct uart_port *uart)
{
	return TIOCM_CAR | TIOCM_DSR | TIOCM_CTS;
}

static void uart9_set_mctrl(struct uart_port *uart, unsigned int mctrl)
{
}

static void uart9_stop_tx(struct uart_port *uart)
{
	/* The timer looks whether it is stopped. */
}

static void uart9_stop_rx(struct uart_port *uart)
{
	uart->ignore_status_mask |= STATUS_DEAF;
}

static const char *uart9_type(struct uart_port *uart)
{
	return "LAB9";
}

static void uart9_release_port(struct uart_port *uart)
{
}

static int uart9_request_port(struct uart_port *uart)
{
	return 0;
}

static void uart9_config_port(struct uart_port *uart, int flags)
{
	uart->type = PORT_16550A;
}

static const struct uart_ops uart9_ops = {
	.tx_empty	= uart9_tx_empty,
	.set_mctrl	= uart9_set_mctrl,
	.get_mctrl	= uart9_get_mctrl,
	.stop_tx	= uart9_stop_tx,
	.start_tx	= uart9_start_tx,
	.stop_rx	= uart9_stop_rx,
	.break_ctl	= uart9_break_ctl,
	.startup	= uart9_startup,
	.shutdown	= uart9_shutdown,
	.set_termios	= uart9_set_termios,
	.type		= uart9_type,
	.release_port	= uart9_release_port,
	.request_port	= uart9_request_port,
	.config_port	= uart9_config_port,
};

static struct uart_driver uart9_driver = {
	.owner		= THIS_MODULE,
	.driver_name	= DRIVER_NAME,
	.dev_name	= "ttyLAB",
};

static int uart9_add_port(struct platform_device *pdev, unsigned int line)
{
	struct uart9_bus *bus = &all[line / ports];
	struct uart9_port *p = &bus->ports[line % ports];
	struct uart_port *uart = &p->port;

	p->bus = bus;
	p->words = words[line / ports] && !(line % ports);
	hrtimer_init(&p->timer, CLOCK_MONOTONIC, HRTIMER_MODE_REL_SOFT);
	p->timer.function = uart9_expired;
	p->baud = 9600;
	p->char_ns = NSEC_PER_SEC / 960;
	spin_lock_init(&uart->lock);
	uart->ops = &uart9_ops;
	uart->dev = &pdev->dev;
	uart->line = line;
	uart->type = PORT_16550A;
	uart->iotype = UPIO_MEM;
	uart->mapbase = line + 1;	/* not 0: that is no port */
	uart->fifosize = 1;
	uart->uartclk = 64000000;
	uart->flags = UPF_BOOT_AUTOCONF;
	uart->rs485_config = uart9_rs485_config;
	uart->rs485_supported = (struct serial_rs485) {
		.flags = SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND | SER_RS485_RTS_AFTER_SEND |
			 SER_RS485_RX_DURING_TX,
		.delay_rts_before_send = 1,
	};
	return uart_add_one_port(&uart9_driver, uart);
}

static void uart9_remove_ports(unsigned int count)
{
	while (count--)
		uart_remove_one_port(&uart9_driver, &all[count / ports].ports[count % ports].port);
}

static int uart9_probe(struct platform_device *pdev)
{
	unsigned int line;
	int error;

	for (line = 0; line < buses * ports; line++) {
		error = uart9_add_port(pdev, line);
		if (error) {
			uart9_remove_ports(line);
			return error;
		}
	}
	return 0;
}

static int uart9_remove(struct platform_device *pdev)
{
	uart9_remove_ports(buses * ports);
	return 0;
}

static struct platform_driver uart9_platform = {
	.driver	= { .name = DRIVER_NAME },
	.probe	= uart9_probe,
	.remove	= uart9_remove,
};

static void uart9_free(void)
{
	unsigned int i;

	for (i = 0; i < buses; i++)
		kfree(all[i].ports);
	kfree(all);
}

static int uart9_alloc(void)
{
	unsigned int i;

	all = kcalloc(buses, sizeof(*all), GFP_KERNEL);
	if (!all)
		return -ENOMEM;
	for (i = 0; i < buses; i++) {
		spin_lock_init(&all[i].lock);
		all[i].full = full[i];
		all[i].ports = kcalloc(ports, sizeof(*all[i].ports), GFP_KERNEL);
		if (!all[i].ports) {
			uart9_free();
			return -ENOMEM;
		}
	}
	return 0;
}

static int __init uart9_init(void)
{
	int error;

	if (!buses || buses > BUSES_MAX || ports < 2 || ports > PORTS_MAX)
		return -EINVAL;
	error = uart9_alloc();
	if (error)
		return error;
	uart9_driver.nr = buses * ports;
	error = uart_register_driver(&uart9_driver);
	if (error)
		goto free;
	/* Not as a bundle: its ports could not be removed by the driver's unbind, as an adapter is unplugged. */
	error = platform_driver_register(&uart9_platform);
	if (error)
		goto unregister;
	device = platform_device_register_simple(DRIVER_NAME, PLATFORM_DEVID_NONE, NULL, 0);
	if (IS_ERR(device)) {
		error = PTR_ERR(device);
		goto driver;
	}
	if (device->dev.driver)
		return 0;
	error = -ENODEV;	/* probing failed */
	platform_device_unregister(device);

driver:
	platform_driver_unregister(&uart9_platform);
unregister:
	uart_unregister_driver(&uart9_driver);
free:
	uart9_free();
	return error;
}

static void __exit uart9_exit(void)
{
	platform_device_unregister(device);
	platform_driver_unregister(&uart9_platform);
	uart_unregister_driver(&uart9_driver);
	uart9_free();
}

module_init(uart9_init);
module_exit(uart9_exit);

MODULE_LICENSE("GPL");
MODULE_DESCRIPTION("Serial ports on simulated 9-bit EIA-485 buses");
