// Sends hostile datagrams to Lcm.cs through its socket, on the bus named by LCM_DEFAULT_URL, and valid messages between
// them. Ends with 0 if no exception escapes, memory stays bounded and every valid message arrives intact.
using System;
using System.Collections.Generic;
using System.Linq;
using System.Net;
using System.Net.Sockets;
using System.Text;
using System.Text.RegularExpressions;
using Bus = LCM.LCM.LCM;

sealed class Hostile
{
    const int Datagrams = 100000, Round = 500, Senders = 40;
    // The messages in fragments may hold 272 MiB.
    const long MemoryMax = 330L << 20;
    const uint Short = 0x4c433032, Fragment = 0x4c433033;
    // At the limits of the fields, and beyond.
    static readonly uint[] Extremes = {
        0, 1, 2, 7, 0xff, 0xffff, 0x10000, 0x10001, 0x7fffffff, 0x80000000, 0xffffffff, 1 << 28, (1 << 28) + 1, 65499,
    };

    readonly Random random = new Random(7);
    readonly Bus bus = new Bus(), sender = new Bus();
    readonly List<Socket> strangers = new List<Socket>();
    readonly IPEndPoint group;
    byte[] expected, arrived;
    long mutants;

    Hostile()
    {
        var url = Regex.Match(Environment.GetEnvironmentVariable("LCM_DEFAULT_URL"), @"^udpm://([0-9.]+):(\d+)");
        group = new IPEndPoint(IPAddress.Parse(url.Groups[1].Value), int.Parse(url.Groups[2].Value));
        for (int n = 0; n < Senders; ++n)
        {
            var stranger = new Socket(AddressFamily.InterNetwork, SocketType.Dgram, ProtocolType.Udp);
            stranger.SetSocketOption(SocketOptionLevel.IP, SocketOptionName.MulticastTimeToLive, 0);
            stranger.MulticastLoopback = true;
            strangers.Add(stranger);
        }
        bus.Subscribe("VALID_MESSAGE", (channel, data) => arrived = data);
        bus.Subscribe("TEST.*", (channel, data) => ++mutants);
    }

    static int Main()
    {
        var test = new Hostile();
        test.Mutations();
        test.OverlappingPieces();
        test.MoreThanIsHeld();
        Console.WriteLine("received {0}, mutants {1}, malformed {2}, incomplete {3}", test.bus.Received, test.mutants,
            test.bus.Malformed, test.bus.Incomplete);
        bool acts = test.mutants > 1000 && test.bus.Malformed > 1000 && test.bus.Incomplete > 100;
        return acts ? 0 : Failed("the datagrams do not reach all of the parser");
    }

    void Mutations()
    {
        for (int n = 0; n < Datagrams; ++n)
        {
            Send(strangers[random.Next(Senders)], Mutated());
            if (n % Round == 0)
            {
                ValidMessagesArrive();
                MemoryIsBounded();
            }
        }
        ValidMessagesArrive();
    }

    // Pieces of one message that lie upon each other: together more than the message has.
    void OverlappingPieces()
    {
        for (int n = 0; n < 6000; ++n)
            Send(strangers[0], Piece(1, 1 << 28, 0, n, 65535, 60000));
        MemoryIsBounded();
        ValidMessagesArrive();
    }

    // Messages of which one piece never arrives, of several senders.
    void MoreThanIsHeld()
    {
        for (int n = 0; n < 6000; ++n)
            Send(strangers[n % 5], Piece(2, 1 << 28, 60000 * (n / 5), n / 5, 4474, 60000));
        MemoryIsBounded();
        ValidMessagesArrive();
    }

    byte[] Mutated()
    {
        byte[] datagram;
        if (random.Next(3) == 0)
            datagram = Header(Short, (uint) random.Next()).Concat(Name()).Concat(Payload()).ToArray();
        else
        {
            int count = random.Next(1, 5), number = random.Next(count);
            var head = number == 0 ? Name() : new byte[0];
            var data = Payload();
            datagram = Header(Fragment, (uint) random.Next(200), (uint) (data.Length * count),
                (uint) (data.Length * number), (uint) number << 16 | (uint) count).Concat(head).Concat(data).ToArray();
        }
        switch (random.Next(8))
        {
            case 0:
                return datagram;
            case 1:
                return datagram.Take(random.Next(datagram.Length + 1)).ToArray();
            case 2:
                return datagram.Take(random.Next(32)).ToArray();
            case 3:
                return datagram.Concat(Noise(random.Next(100))).ToArray();
            case 4: // A field of the header at a limit.
                int at = 4 * random.Next(5);
                byte[] field = Header(Extremes[random.Next(Extremes.Length)]);
                field.CopyTo(datagram, at < datagram.Length - 4 ? at : 0);
                return datagram;
            case 5: // Two halves of a field.
                int half = 16 + 2 * random.Next(2);
                if (half < datagram.Length)
                    datagram[half] = (byte) random.Next(256);
                return datagram;
            case 6: // The longest datagram that UDP carries.
                return datagram.Concat(new byte[random.Next(100) == 0 ? 65507 - datagram.Length : 0]).ToArray();
            default:
                for (int flips = random.Next(1, 9); flips > 0; --flips)
                    datagram[random.Next(datagram.Length)] ^= (byte) (1 << random.Next(8));
                return datagram;
        }
    }

    byte[] Piece(uint message, uint total, int offset, int number, int count, int size)
    {
        var head = number == 0 ? Encoding.ASCII.GetBytes("TEST\0") : new byte[0];
        return Header(Fragment, message, total, (uint) offset, (uint) number << 16 | (uint) count).Concat(head)
            .Concat(new byte[size - head.Length]).ToArray();
    }

    byte[] Name()
    {
        switch (random.Next(8))
        {
            case 0:
                return Noise(random.Next(80));                        // mostly no UTF-8, mostly without an end
            case 1:
                return Encoding.ASCII.GetBytes(new string('T', random.Next(60, 70)) + '\0');
            case 2:
                return new byte[] { 0 };
            default:
                return Encoding.ASCII.GetBytes("TEST" + random.Next(2000) + '\0');
        }
    }

    byte[] Payload() { return Noise(random.Next(random.Next(20) == 0 ? 2000 : 200)); }

    byte[] Noise(int size)
    {
        var bytes = new byte[size];
        random.NextBytes(bytes);
        return bytes;
    }

    static byte[] Header(params uint[] fields)
    {
        return fields.SelectMany(field => BitConverter.GetBytes(field).Reverse()).ToArray();
    }

    // Each is received before the next is sent, so that the system drops none.
    void Send(Socket from, byte[] datagram)
    {
        from.SendTo(datagram, group);
        while (bus.HandleDatagram()) { }
    }

    void ValidMessagesArrive()
    {
        foreach (int size in new[] { 100, 200000 })
        {
            expected = Noise(size);
            arrived = null;
            sender.Publish("VALID_MESSAGE", expected);
            for (int n = 0; n < 100 && arrived == null; ++n)
                bus.HandleTimeout(100);
            if (arrived == null || !arrived.SequenceEqual(expected))
                Environment.Exit(Failed("a valid message of " + size + " bytes does not arrive"));
        }
    }

    static void MemoryIsBounded()
    {
        long used = GC.GetTotalMemory(true);
        if (used > MemoryMax)
            Environment.Exit(Failed(used + " bytes of memory"));
    }

    static int Failed(string why)
    {
        Console.Error.WriteLine(why);
        return 1;
    }
}
